# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
# %% [markdown]
# # Reading results: tables, histories, spectra, pictures
#
# The coarse arch dam of the [first steps](00_first_steps.py) is shaken for two seconds. Then its
# results file is read as in a notebook. Everything below the run needs only the file, not DOLFINx
# or MPI.
#
#     ./with-dolfinx python3 demos/08_results.py
# %%
from mpi4py import MPI

import dolfinx_joints as dj
from dolfinx_joints import export, measures, plots, views
from dolfinx_joints.geometry.ambiesta import ambiesta, mid_crest

dam = dj.read_msh(ambiesta("dam.msh", size=8.0, order=1, active_height=1.0), MPI.COMM_WORLD)
model = dj.Model(
    dam,
    material=dj.Elastic(young=25.92e9, poisson=0.2, density=2400.0),
    joints=dj.FrictionNoTension(
        normal_stiffness=1e11, shear_stiffness=4e10, friction_angle_deg=30.0
    ),
    supports=[dj.Fixed(group="base"), dj.Fixed(group="abutments")],
    loads=[dj.Gravity()],
    damping=dj.stiffness_proportional(ratio=0.02, frequency=5.0),
)
model
# %%
crest = dj.Probe(mid_crest(), group="joint_6+")
monitor = dj.ResultsMonitor("dam.h5", points={"crest": crest}, overwrite=True)
run = dj.Simulation(model, monitors=[monitor])
run.statics()
motion = dj.synthetic_motion(duration=2.0)
outcome = run.dynamics(dt=0.001, steps=2000, motion=motion)
outcome
# %% [markdown]
# ## The file
#
# The file is the same on any number of ranks, and complete at any time during the run.
# %%
results = dj.Results("dam.h5")
results
# %% [markdown]
# ## Peaks and histories
#
# The crest moves by about 15 mm. Accelerations are low-passed at 25 Hz. A warning states that this
# is beyond the frequencies that step and mesh
# [resolve](../docs/guide/accelerations.md#what-a-run-resolves): cells of 8 m resolve 18 Hz.
# %%
peaks = export.to_pandas(results, "peaks").set_index("peak")
moved = "displacement of crest from the static state"
slip = "slip of joint_1 from the static state"
print(peaks.loc[[moved, "opening of joint_1", slip]].to_string())
# %%
plots.history(results, "crest", "x")
# %%
plots.joint_histories(results)[0].figure
# %% [markdown]
# ## Spectra
# %%
plots.response_spectra(results, "crest", "x")
# %% [markdown]
# ## Pictures
#
# The dam at the time of the widest opening, with enlarged displacements, and the openings of the
# joints. `plots.save` writes a figure to a file, here `openings.png`.
# %%
widest = max(results.joints, key=lambda name: measures.joint_measures(results)[name]["opening_max"])
extremes = measures.joint_extremes(results, widest)
moment = float(extremes.time[extremes.opening.argmax()])
print(f"{widest} opens by {1e3 * extremes.opening.max():.2f} mm at {moment:.3f} s")
views.deformed(results, time=moment)
# %%
figure = views.joint_map(results, "opening", time=moment)
print("figure:", plots.save(figure, "openings.png"))
figure
# %% [markdown]
# ## Other programs
#
# In xarray the joint points have coordinates. `dolfinx-joints vtk dam.h5` writes files for ParaView
# ([guide](../docs/guide/export.md)).
# %%
states = export.to_xarray(results, "states")
pressure = (-states["traction"]).sel(axis="n").max("joint_point")
print(f"largest pressure in the stored states: {1e-6 * float(pressure.max()):.2f} MPa")
results.close()
