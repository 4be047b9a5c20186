# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
# %% [markdown]
# # Joints in a user-defined solver
#
# An eccentric pressure acts on two rubber blocks, so the joint between them opens on one side and
# slides. The blocks are a neo-Hookean body in UFL, solved by PETSc's SNES. The package computes
# residual and tangent of the joint. The [guide](../docs/guide/own_solver.md) explains the calls.
# The run takes about 10 seconds.
#
#     ./with-dolfinx python3 demos/09_own_newton.py
#     ./with-dolfinx mpirun -n 2 python3 demos/09_own_newton.py

# %%
from pathlib import Path

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from matplotlib import pyplot
from petsc4py import PETSc

import dolfinx_joints as dj
from dolfinx_joints.common.mpi import on_root
from dolfinx_joints.geometry.jointed_wall import jointed_wall

comm, out = MPI.COMM_WORLD, Path("output/09_own_newton")
dj.abort_on_error(comm)

# %% [markdown]
# ## The joint
#
# A `Model` contains the joint: its points, its law, and the space `V`. Its linear material is used
# only for the comparison at small loads. The mean pressure on the end face is 1 Pa, with its
# resultant 0.2 m above the middle. A shear traction of 0.2 Pa acts upwards.

# %%
out.mkdir(parents=True, exist_ok=True)
box = {"length": 2.0, "thickness": 1.0, "height": 1.0, "joints": 1, "divisions": (8, 2, 6)}
if comm.rank == 0:
    print("Two rubber blocks under three loads: about 10 seconds.")
blocks = dj.read_msh(on_root(comm, lambda: jointed_wall(out / "blocks.msh", **box)), comm)


def press(v):
    """Return the form of the load with the test function v."""
    z = ufl.SpatialCoordinate(blocks.mesh)[2]
    return (-(1.0 + 2.4 * (z - 0.5)) * v[0] + 0.2 * v[2]) * blocks.ds("x_max")


rubber = dj.Elastic(young=1e7, poisson=0.3, density=1100.0)
law = dj.FrictionNoTension(normal_stiffness=1e9, shear_stiffness=4e8, friction_angle_deg=30.0)
support, load = dj.Fixed(group="x_min"), dj.FormLoad(form=press)
model = dj.Model(blocks, material=rubber, joints=law, supports=[support], loads=[load])
operator, contact, V = model.operator, model.contact, model.V
linear = dj.Simulation(model).statics().displacement

# %% [markdown]
# ## The body
#
# Compressible neo-Hookean rubber under a dead load.

# %%
u, v, du = fem.Function(V), ufl.TestFunction(V), ufl.TrialFunction(V)
pressure = fem.Constant(blocks.mesh, 0.0)
F = ufl.Identity(3) + ufl.grad(u)
J = ufl.det(F)
mu, lmbda = rubber.young / 2.6, rubber.young * 0.3 / (1.3 * 0.4)
energy = 0.5 * mu * (ufl.tr(F.T * F) - 3.0 - 2.0 * ufl.ln(J)) + 0.5 * lmbda * ufl.ln(J) ** 2
bulk = ufl.derivative(energy * ufl.dx, u, v) - pressure * press(v)
bulk_residual, bulk_tangent = fem.form(bulk), fem.form(ufl.derivative(bulk, u, du))
fixed = fem.locate_dofs_topological(V, 2, blocks.facets("x_min"))
bcs = [fem.dirichletbc(np.zeros(3), fixed, V)]

# %% [markdown]
# ## Residual and tangent for SNES
#
# `contact.trial` evaluates the law from the state of the last accepted step. `operator.force` and
# `joint_tangent.assemble` turn tractions and tangents of the points into nodal forces and a matrix.

# %%
free = u.x.petsc_vec.duplicate()
free.set(1.0)
free.getArray()[model.constraints.dofs] = 0.0
joint_tangent = operator.tangent_matrix(free)
state = contact.at_rest(u.x.petsc_vec)


def set_displacement(x):
    """Copy the displacement of SNES to `u`."""
    x.copy(u.x.petsc_vec)
    u.x.scatter_forward()


def residual(snes, x, f):
    """Sum the forces of the body and of the joint; constrained rows are zero."""
    set_displacement(x)
    operator.force(contact.trial(x, state).traction, f)
    b = fem_petsc.assemble_vector(bulk_residual)
    b.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
    f.axpy(1.0, b)
    f.pointwiseMult(f, free)


def tangent(x):
    """Sum the tangents of the body and of the joint."""
    set_displacement(x)
    matrix = fem_petsc.assemble_matrix(bulk_tangent, bcs)
    matrix.assemble()
    joint = joint_tangent.assemble(contact.trial(x, state).tangent)
    matrix.axpy(1.0, joint, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    return matrix


solution = model.mass.createVecRight()
snes = PETSc.SNES().create(comm)
snes.setFunction(residual, solution.duplicate())
snes.setJacobian(lambda snes, x, matrix, P: tangent(x).copy(P), tangent(solution))
snes.setTolerances(rtol=1e-10)
snes.getKSP().getPC().setType("lu")
snes.setFromOptions()  # PETSC_OPTIONS=-snes_monitor shows the iterations

# %% [markdown]
# ## Three loads
#
# Each load acts on the unloaded blocks, because `state` is the state at rest. A path of loads would
# continue from `response.state`. The tractions, as Functions on the joint, balance the load for any
# body. The difference to the linear solution decreases with the load, as the strains do.

# %%
functions, apart = dj.JointFunctions(model), []
carried = blocks.form(-functions.traction("-")[0] * functions.dS)
for value in (1e2, 1e3, 1e4):
    solution.scale(value / (float(pressure.value) or 1.0))
    pressure.value = value
    snes.solve(None, solution)
    response = contact.trial(solution, state)
    functions.update(response)
    force = comm.allreduce(fem.assemble_scalar(carried))
    assert snes.getConvergedReason() > 0
    assert np.isclose(force, value, rtol=1e-9)  # the face has 1 m^2
    apart.append((solution / value - linear).norm() / linear.norm())
    if comm.rank == 0:
        print(f"{value:5g} Pa: joint force {force:.12g} N, off the linear solution {apart[-1]:.3e}")
assert np.isclose(apart[1] / apart[0], 10.0, rtol=0.05)

# %% [markdown]
# ## Opening and pressure over the height of the joint
#
# The figure shows the largest load.

# %%
values = operator.points[:, 2], 1e3 * response.state.gap[:, 0], -1e-3 * response.traction[:, 0]
z, gap, joint_pressure = (operator.gather(each) for each in values)
if comm.rank == 0:
    figure, (left, right) = pyplot.subplots(1, 2, sharey=True, figsize=(8, 4), layout="constrained")
    left.plot(gap, z, "o")
    right.plot(joint_pressure, z, "o")
    left.set(xlabel="normal gap [mm]", ylabel="height [m]")
    right.set(xlabel="pressure in the joint [kPa]")
    print("picture:", dj.plots.save(figure, out / "joint.png"))
