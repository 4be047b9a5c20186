# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
# %% [markdown]
# # A joint law in UFL, and integrals over joints
#
# The construction joints of the arch dam of the [first steps](00_first_steps.py) get a user-defined
# law: a bond with a strength and an energy of separation. Its traction decreases exponentially as
# it opens or slides. The dam carries its weight and is shaken for 0.2 s. One run integrates the
# joints over interior facets, the other uses the operator B.
#
#     ./with-dolfinx python3 demos/05_joint_law_in_ufl.py

# %%
import math
from pathlib import Path

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem

import dolfinx_joints as dj
from dolfinx_joints import plots, views
from dolfinx_joints.common.mpi import abort_on_error, on_root
from dolfinx_joints.geometry.ambiesta import ambiesta, mid_crest

comm = MPI.COMM_WORLD
abort_on_error(comm)
out = Path("output/05_joint_law_in_ufl")
on_root(comm, lambda: out.mkdir(parents=True, exist_ok=True))


def say(text: str) -> None:
    """Print on rank 0."""
    if comm.rank == 0:
        print(text, flush=True)


# %% [markdown]
# ## The law
#
# Faces in contact are elastic. UFL derives traction and tangent from the energy. The bond is
# reversible: it carries load again when the joint closes. A `TractionJoint` can have a memory.

# %%
STIFFNESS, STRENGTH, SEPARATION = 1e11, 5e5, 250.0  # pressed [Pa/m]; bond [Pa], [J/m^2]
LENGTH = SEPARATION / (math.sqrt(math.e) * STRENGTH)  # gap at which the strength is reached [m]


def energy(g):
    """Return the stored energy of a gap (n, s1, s2) [J/m^2]."""
    apart = (ufl.max_value(g[0], 0.0) ** 2 + g[1] ** 2 + g[2] ** 2) / (2.0 * LENGTH**2)
    return 0.5 * STIFFNESS * ufl.min_value(g[0], 0.0) ** 2 + SEPARATION * (1.0 - ufl.exp(-apart))


law = dj.PotentialJoint(energy, normal_stiffness=STIFFNESS, shear_stiffness=SEPARATION / LENGTH**2)

# %% [markdown]
# ## The dam by forms and by B
#
# `solver="forms"` assembles residual and tangent as interior-facet integrals,
# `inner(t, jump(v)) * dS`, with the tractions of the law at the quadrature points. `"monolithic"`
# computes the same sums with a matrix. The energy-consistent scheme balances the energy of the law.

# %%
say("An arch dam is shaken in two runs of 40 steps. All takes about 10 seconds.")
mesh = out / "dam.msh"
on_root(comm, lambda: ambiesta(mesh, size=8.0, order=1, active_height=1.0))
dam = dj.read_msh(mesh, comm)
model = dj.Model(
    dam,
    material=dj.Elastic(young=25.92e9, poisson=0.2, density=2400.0),
    joints=law,
    supports=[dj.Fixed(group="base"), dj.Fixed(group="abutments")],
    loads=[dj.Gravity()],
    damping=dj.stiffness_proportional(ratio=0.02, frequency=5.0),
)
STEPS, DT = 40, 0.005
outcomes = {}
for solver in ("forms", "monolithic"):
    crest = dj.Probe(mid_crest(), group="joint_6+")
    monitor = dj.ResultsMonitor(
        out / f"{solver}.h5", points={"crest": crest}, every=5, overwrite=True
    )
    run = dj.Simulation(model, monitors=[monitor], solver=solver)
    run.statics()
    motion = dj.synthetic_motion(duration=2.0).scaled(0.5)
    outcomes[solver] = run.dynamics(dt=DT, steps=STEPS, motion=motion)
    say(f"{solver}: {1e3 * run.seconds['time steps'] / STEPS:.0f} ms per step")
    say(run.report(outcomes[solver]))
by_forms, by_operator = (outcome.state.displacement for outcome in outcomes.values())
apart = (by_operator - by_forms).norm() / by_forms.norm()
say(f"displacements by forms and by B differ by {apart:.1e}")

# %% [markdown]
# ## Integrals over joints
#
# The faces of a joint are exterior facets of a split mesh, so `ufl.dS` contains no joint. The
# measure of joints is `JointedMesh.dS`, for forms in any function space on the mesh.

# %%
u, n = model.function(by_forms), ufl.FacetNormal(dam.mesh)("-")


def integral(measure) -> float:
    """Return the volume between the faces [m^3] by a measure."""
    return comm.allreduce(fem.assemble_scalar(fem.form(ufl.dot(ufl.jump(u), n) * measure)))


volume = model.contact.integral(model.operator.jump(by_forms)[:, 0])
say(f"volume between the faces, by B:           {volume:.15g} m³")
say(f"by JointedMesh.dS, of all joints:         {integral(dam.dS(quadrature='nodal')):.15g} m³")
if comm.size == 1:  # on several ranks DOLFINx needs more ghost cells than joints do
    say(f"by UFL's dS, which knows no joint:        {integral(ufl.dS(domain=dam.mesh)):.1g} m³")

# %% [markdown]
# ## Where the bond is lost
#
# The picture shows the normal tractions at the end of the run. A bond is past its strength if its
# gap exceeds `LENGTH`.


# %%
def past_strength() -> float:
    """Draw the tractions; return the share of points past the strength at a recorded time."""
    with dj.Results(out / "forms.h5") as file:
        picture = plots.save(views.joint_map(file, "normal"), out / "tractions.png", dpi=120)
        print(f"picture: {picture}; results: {out}/*.h5")
        gaps = np.concatenate([file.series("states", f"joints/{j}/gap") for j in file.joints], 1)
    apart = np.hypot(np.maximum(gaps[..., 0], 0.0), np.linalg.norm(gaps[..., 1:], axis=-1))
    return float((apart > LENGTH).any(axis=0).mean())


lost = on_root(comm, past_strength)
say(f"past the strength of {STRENGTH / 1e6:g} MPa: {lost:.0%} of the joint points")

# %% [markdown]
# ## Verification
#
# Both runs have the same solution within the tolerance of Newton's method, the energies balance,
# and both integrals agree.

# %%
assert apart < 1e-10
assert all(outcome.imbalance < 1e-10 for outcome in outcomes.values())
assert math.isclose(integral(dam.dS(quadrature="nodal")), volume, rel_tol=1e-12)
assert 0.0 < lost < 1.0
