# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
# %% [markdown]
# # How it works: the formulation in sixty lines
#
# A wall of four blocks is shaken until its joints open and slide. The demo uses DOLFINx and PETSc
# only: weak form, return mapping at the quadrature points of the joints, Newmark's method and
# Newton's method. The displacement $u$ at the end of a step satisfies
#
# $$\int \rho\,(\ddot u + a_g)\cdot v + \sigma(u + c\,\dot u):\nabla v\;dx
#   + \int_{joints} t(R\,[u])\cdot R\,[v]\;dS = 0$$
#
# for all test functions $v$. The jump $[u] = u^+ - u^-$, rotated by $R$ into the local axes $(n,
# s_1, s_2)$ of a joint, is the gap; $t$ is the traction of the friction no-tension law. The ground
# has the acceleration $a_g$, and $c$ is the factor of the damping. At the end the package repeats
# the run, and the demo compares both. It is for one rank, takes about 20 seconds, and writes
# `wall.msh`, `wall.h5` and `how_it_works.png` to the current folder.
#
#     ./with-dolfinx python3 demos/06_how_it_works.py

# %%
from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from petsc4py import PETSc

import dolfinx_joints as dj
from dolfinx_joints.geometry.jointed_wall import jointed_wall
from dolfinx_joints.laws.law import JointState

# %% [markdown]
# ## Mesh and spaces
#
# Gmsh makes the mesh, and `read_msh` splits it: nodes on joints exist twice, so functions of the
# continuous space `V` jump there. Traction `t` and tangent `D` have a value at each quadrature
# point of the joints, and `q` is a test function of such values. The points of the nodal rule are
# the nodes.

# %%
wall = dj.read_msh(jointed_wall("wall.msh", divisions=(12, 1, 6)), MPI.COMM_WORLD)
V = fem.functionspace(wall.mesh, ("Lagrange", 1, (3,)))
Q, Q2 = (wall.surface().quadrature_space("nodal", 1, shape) for shape in ((3,), (3, 3)))
u, u0, v0, a0 = (fem.Function(V) for _ in range(4))
t, D, q = fem.Function(Q), fem.Function(Q2), ufl.TestFunction(Q)
du, v = ufl.TrialFunction(V), ufl.TestFunction(V)

# %% [markdown]
# ## The elastic body
#
# Newmark's method with average acceleration expresses velocity and acceleration at the end of a
# step by the displacement `u` there and by the values at the start of the step.

# %%
DT, STEPS, motion = 0.004, 170, dj.synthetic_motion(duration=2.0, peaks_g=(0.5, 0.5, 0.3))
solid = dj.Elastic(young=25.92e9, poisson=0.2, density=2400.0)
damp = dj.stiffness_proportional(ratio=0.02, frequency=5.0)
rho, mu, ground = solid.density, solid.young / 2.4, fem.Constant(wall.mesh, np.zeros(3))
velocity = 2.0 / DT * (u - u0) - v0
acceleration = 2.0 / DT * (velocity - v0) - a0
strain = ufl.sym(ufl.grad(u + damp.stiffness_factor * velocity))
stress = 2.0 * mu * (strain + 0.2 / 0.6 * ufl.tr(strain) * ufl.Identity(3))
bulk = (rho * ufl.inner(acceleration + ground, v) + ufl.inner(stress, ufl.grad(v))) * ufl.dx

# %% [markdown]
# ## The joints
#
# `wall.dS` is the measure of all joints, and `wall.frame` the matrix $R$. The joints of this wall
# are parallel, so all have the same matrix.

# %%
law = dj.FrictionNoTension(normal_stiffness=1e10, shear_stiffness=4e9, friction_angle_deg=30.0)
R, dS = wall.frame("joint_1"), wall.dS(quadrature="nodal", degree=1)
gap = wall.form(ufl.inner(R * ufl.jump(u), q("-")) * dS)
areas = fem.assemble_vector(wall.form(ufl.inner(ufl.as_vector((1, 1, 1)), q("-")) * dS)).array
residual = wall.form(bulk + ufl.inner(t("-"), R * ufl.jump(v)) * dS)
contact = ufl.inner(D("-") * R * ufl.jump(du), R * ufl.jump(v)) * dS
tangent = wall.form(ufl.derivative(bulk, u, du) + contact)

# %% [markdown]
# ## Time steps
#
# In each iteration of Newton's method the law maps gaps to tractions and tangents. It always starts
# from the state at the start of the step, so rejected iterates do not affect the history of the
# joints. Full Newton steps converge here; stiffer joints need the line search of the package.

# %%
bcs = [fem.dirichletbc(np.zeros(3), fem.locate_dofs_topological(V, 2, wall.facets("base")), V)]
x, ksp = u.x.petsc_vec.duplicate(), PETSc.KSP().create()
ksp.getPC().setType("lu")
state = JointState.at_rest(np.zeros((len(areas) // 3, 3)))
for step in range(1, STEPS + 1):
    ground.value = motion(DT * step)
    for _ in range(20):
        gaps = (fem.assemble_vector(gap).array / areas).reshape(-1, 3)
        response = law.backward_euler(gaps, state)
        t.x.array[:], D.x.array[:] = response.traction.ravel(), response.tangent.ravel()
        b, matrix = fem_petsc.assemble_vector(residual), fem_petsc.assemble_matrix(tangent, bcs)
        fem_petsc.set_bc(b, bcs)
        matrix.assemble()
        ksp.setOperators(matrix)
        ksp.solve(b, x)
        u.x.petsc_vec.axpy(-1.0, x)
        if x.norm() <= 1e-10 * u.x.petsc_vec.norm():
            break
    v1 = 2.0 / DT * (u.x.array - u0.x.array) - v0.x.array
    a0.x.array[:] = 2.0 / DT * (v1 - v0.x.array) - a0.x.array
    u0.x.array[:], v0.x.array[:], state = u.x.array, v1, response.state

# %% [markdown]
# ## The same run by the package

# %%
model = dj.Model(wall, material=solid, joints=law, supports=[dj.Fixed(group="base")], damping=damp)
monitor = dj.ResultsMonitor("wall.h5", points={"top": (0.0, 0.0, 20.0)}, every=5, overwrite=True)
run = dj.Simulation(model, monitors=[monitor], solver="monolithic")
end = run.dynamics(dt=DT, steps=STEPS, motion=motion, scheme=dj.Newmark())
apart = (end.state.displacement - u.x.petsc_vec).norm() / u.x.petsc_vec.norm()
print(f"{STEPS} steps; the displacements of demo and package differ by {apart:.1e} of their size")
print("picture:", dj.plots.save(dj.views.deformed(dj.Results("wall.h5")), "how_it_works.png"))
assert apart < 1e-8
