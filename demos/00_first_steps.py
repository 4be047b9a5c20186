# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
# %% [markdown]
# # First steps: an arch dam whose joints open
#
# A coarse dam with 11 vertical joints that reach the crest carries its own weight and is then
# shaken for two seconds by a synthetic motion. It is the example of the README, written for one
# rank. The script writes the mesh `dam.msh`, the results `dam.h5` and the picture
# `first_steps.png` to the current folder.
#
#     ./with-dolfinx python3 demos/00_first_steps.py

# %%
from mpi4py import MPI

import dolfinx_joints as dj
from dolfinx_joints import plots, views
from dolfinx_joints.geometry.ambiesta import ambiesta, mid_crest

mesh = ambiesta("dam.msh", size=8.0, order=1, active_height=1.0, duplicated=True)
dam = dj.read_msh(mesh, MPI.COMM_WORLD)
law = dj.FrictionNoTension(normal_stiffness=1e11, shear_stiffness=4e10, friction_angle_deg=30.0)
solid = dj.Elastic(young=25.92e9, poisson=0.2, density=2400.0)
damp = dj.stiffness_proportional(ratio=0.02, frequency=5.0)
rock = [dj.Fixed(group="base"), dj.Fixed(group="abutments")]
model = dj.Model(dam, material=solid, joints=law, supports=rock, loads=[dj.Gravity()], damping=damp)
crest = dj.Probe(mid_crest(), group="joint_6+")  # on a joint: one of its sides
monitor = dj.ResultsMonitor("dam.h5", points={"crest": crest}, overwrite=True)
run = dj.Simulation(model, monitors=[monitor])
run.statics()
print(run.report(run.dynamics(dt=0.001, steps=2000, motion=dj.synthetic_motion(duration=2.0))))
plots.save(views.deformed(dj.Results("dam.h5"), time=0.5), "first_steps.png", dpi=120)
