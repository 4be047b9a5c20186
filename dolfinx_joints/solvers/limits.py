# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Thresholds of the solvers: tolerances, sizes at which a method changes, limits of iterations.

Each comment states the trade-off behind a value and its source. `tests/solvers/test_limits.py`
names the test or the page that shows its effect. docs/theory/solvers.md defines the symbols.
User options are in `SolverOptions`, PETSc options next to their solvers. Read a value as
``limits.NAME``, so that a test can replace it; compiled loops read it when they are compiled.
"""

import sys

# ROUNDING
EPSILON = sys.float_info.epsilon

# Rounding error of A x relative to |A| |x|, and of joint forces relative to the gaps from which
# they are computed (sums over many dofs).
PRODUCT_ROUNDING, GAP_ROUNDING = 4.0 * EPSILON, 64.0 * EPSILON

# Relative error of a product in single precision, about ten roundings of 6e-8. A new GMRES
# direction of this relative length is rounding error.
SINGLE_ROUNDING = 1e-6

# Largest residual accepted as rounding error, relative to the forces. The first value is for joints
# millions of times stiffer than the body. The second is for steps whose rounding error exceeds all
# joint forces, as at points that only just close. The third is for forces of artificial springs, if
# blocks fall far before contact. With smaller values steps fail; larger values would accept errors
# or mechanisms.
LARGEST_ROUNDING, LARGEST_CONTACT_ROUNDING, LARGEST_SPRING_ROUNDING = 1e-6, 1e-3, 1e-8

# Residual of unsupported blocks that is accepted as rounding error, relative to the largest force.
# Correcting it would move blocks that can rest anywhere.
BALANCED = 1e-12

# A static tangent is singular if the condition estimate |A| |x| / |f| for random forces f exceeds
# this value, two digits below the inverse of the rounding unit.
SINGULAR_GROWTH = 0.01 / EPSILON

# A matrix is singular if the relative residual of the first solve exceeds the first value; LU may
# not report the singularity. The second, stricter value detects unsupported blocks in K; springs on
# a supported block do not change the result.
FACTOR_RESIDUAL, SUPPORTED_RESIDUAL = 1e-2, 1e-6

# NEWTON'S METHOD
# If the residual is not below LEAST_FALL times the residual PATIENCE iterations ago, apply
# WHOLE_CORRECTIONS full corrections: halved ones may creep towards a kink that is not a solution.
PATIENCE, LEAST_FALL, WHOLE_CORRECTIONS = 5, 0.9, 2

# Share of the residual that may remain after the first correction: of the body by multigrid, of the
# joint forces in time steps, and in statics, which has few solves. Smaller values need more
# products, larger ones more iterations.
BODY_FORCING, JOINT_FORCING, STATIC_FORCING = 0.1, 0.03, 3e-4

# Share of the accepted residual below which no correction aims. One more correction of the body
# then reduces the residual to its share POLISH, so that the energy balances to rounding error.
FORCING_MARGIN, POLISH = 0.3, 0.01

# The iteration on joint forces continues to this share of the tolerance, or to rounding error,
# because the energy balance depends on the residual. In statics: share of the largest force.
END_OF_STEPS, END_OF_STATICS = 0.01, 1e-14

# The iteration ends at an accepted residual if a correction reduces it to no less than the share
# STALLED. Entries below CONVERGED_ENTRIES of the target residual are dropped and cost no product.
STALLED, CONVERGED_ENTRIES = 0.5, 0.1

# Corrections add the rounding error of single precision to S f. If the error exceeds STALE of the
# residual, S f is recomputed. If the error will exceed STALE_NEXT of the next residual under
# quadratic convergence, the next S f is computed in double precision. Both are omitted if the error
# is below NEGLIGIBLE of the target residual. With W the true error was up to 8 times the estimate.
STALE, STALE_NEXT, NEGLIGIBLE = 0.1, 0.3, 0.03

# Shares of the closed joints' stiffness added to a singular tangent, tried in turn. The first share
# that makes the tangent regular is used, because a larger one makes corrections less exact.
REGULARISATIONS = (0.0, 1e-4, 1e-2)

# Largest relative change of a static solution by one more correction, if the residual is accepted
# as rounding error. The solution of an unsupported block changes by more.
SETTLED = 1e-5

# STATICS OF JOINTS
# Number of times that a static solution is repeated from the gaps of the body, because stiff joints
# turn rounding errors of gaps into forces.
REFINEMENTS = 3

# Residual divided by the largest force up to which a static increment starts on the line through
# the last two accepted states. This start saves iterations under proportional loading.
ON_LINE = 1e-3

# Largest product c sigma with the artificial springs (27). At a point that only its own spring
# supports, c sigma = 1 and 1 / (1 - c sigma) is infinite; a smaller c gives the same solution.
SPRING_COMPLIANCE = 0.9

# Largest product of compliance and softening of a bond, below 1. The compliance is that of a point
# on the condensed solver, and in statics that of the cells with all other nodes fixed.
SOFTENING_COMPLIANCE = 0.9

# Share of the artificial springs kept in the Newton matrix. Without this share the matrix is
# singular if a block is open or frictionless. The equilibrium does not depend on the share.
SPRING_REGULARISATION = 1e-6

# Added to the diagonal of I + T S if joints are rigid. If sticking points tie each other, the
# matrix is singular, and corrections would amplify rounding error.
RIGID_DAMPING = 1e-8

# Multiple of the step's residual below which the opening of a rigid point is set to zero. Where
# rigid joints meet, the opening would contradict the sticking points in all later steps.
RIGID_OPENING = 10.0

# Smallest change c.z of a controlled displacement by its load, relative to the bound of Cauchy and
# Schwarz, sqrt((f.z) (c.y)) (28g). Below this value the change is rounding error.
CONTROLLABLE = 1e-9

# Pseudo-time: 1/dt^2 of the first and the last step relative to |K|/|M|, factor of 1/dt^2 per step,
# and largest number of steps. Other factors do not find more equilibria.
PSEUDO_FIRST, PSEUDO_LAST, PSEUDO_FALL, PSEUDO_STEPS = 1e-2, 1e-15, 0.1, 20

# Largest relative change of x in the last step in pseudo-time, if the rounding error of the inertia
# exceeds the tolerance. On a mechanism most of x changes.
PSEUDO_SETTLED = 1e-3

# CORRECTIONS OF JOINT FORCES
# Largest number of products per correction by GMRES; the last correction is then used.
MOST_PRODUCTS = 100

# Average number of products per correction, to compare the costs of active set and complement.
TYPICAL_PRODUCTS = 10

# Tightest tolerances of GMRES in single precision, and with S compressed to ROUGH_COMPRESSION.
# Tighter ones cannot be reached: GMRES would then compute all MOST_PRODUCTS products.
FINEST_SINGLE, FINEST_COMPRESSED = 1e-5, 1e-3

# Share of the squared norm of a new direction below which GMRES orthogonalises it once more.
ORTHOGONAL_REST = 0.01

# A point sticks if T and T0, both between 0 and 1, differ by no more than this rounding error.
SAME_TANGENT = 1e-12

# Number of entries read without W, divided by m^3, after which W is computed. W costs 2.3 m^3
# operations; five take as long as reading an entry in single precision. W is computed after a
# quarter of its cost has been spent, because most runs are long.
COMPLEMENT_COST = 2.3 / 20.0

# Pivot of I + T0 S below which W is not used: sticking points then tie each other, and W would
# amplify the residuals of corrections.
COMPLEMENT_PIVOT = 0.03

# Share of nonzero entries in a vector above which half of a symmetric S is read faster than the
# columns of these entries.
NONZERO_SHARE = 0.6

# Largest size of a kept set of points: SET_EXCESS times the required number plus SET_SPARE. Larger
# sets are renewed more rarely, but cost more in each product.
SET_EXCESS, SET_SPARE = 1.4, 20

# COMPLIANCE OF THE JOINTS
# Joint unknowns up to which the compliance is dense. With more unknowns a compressed compliance
# takes less memory and its products are faster.
LARGEST_DENSE = 2000

# Joint unknowns m up to which matrices of m^2 entries are stored next to a compressed S: S in
# single precision (0.15 GB on all ranks together) and W (0.3 GB).
LARGEST_WHOLE = 6000

# Joint unknowns from which another factorization computes all columns at once. Relative error above
# which these columns are rejected: MUMPS has returned wrong columns.
SMALLEST_AT_ONCE, AT_ONCE_ERROR = 300, 1e-8

# Number of points whose exact diagonal scales an estimate, and number of compared columns.
SAMPLES = 8

# Columns solved per block: with fewer columns the factor is read more often, more save no time.
BLOCK_COLUMNS = 64

# Number of compliance columns that take as long as a static solve without a stored compliance: 250
# products, with 7 columns of a block in the time of one back-substitution.
STATIC_SOLVE_COLUMNS = 1750

# Error of the compressed S, relative to the unit diagonal of I + S, and of the rougher S used in
# corrections, whose products take a fifth of the time.
COMPRESSION, ROUGH_COMPRESSION = 1e-12, 1e-4

# Points of the smallest clusters; clusters of 48 need the same memory and slightly more time.
CLUSTER_POINTS = 96

# A low-rank block is tried if the smaller cluster's diameter is at most ADMISSIBLE_SIZE times the
# clusters' distance. It is kept if it needs at most LOW_RANK_SHARE of the dense block's memory.
ADMISSIBLE_SIZE, LOW_RANK_SHARE = 4.0, 0.9

# Entries by which the array of all blocks is enlarged in place, which avoids a copy.
STORE_GROWTH = 1_000_000

# Matrices kept, one per step length. The condensed solver keeps as many as dense compliances fit
# into KEPT_BYTES, from FEWEST_KEPT to MOST_KEPT. The monolithic solver has TANGENTS_KEPT tangents,
# or FEWEST_KEPT if they are solved by iteration.
KEPT_BYTES, FEWEST_KEPT, TANGENTS_KEPT, MOST_KEPT = 2_000_000_000, 2, 4, 8

# SOLVERS OF THE BODY
# Mean entries per column of the factor, and rows of the matrix, up to which a factor in node blocks
# is used. With more rows its set-up and the compliance columns cost too much.
NODE_BLOCK_COLUMN, NODE_BLOCK_ROWS = 150.0, 25_000

# Residual of multigrid relative to the right-hand side, as small as with direct solvers. In linear
# steps it may be larger: it does no work in the step, and the next step corrects it.
MULTIGRID_TOLERANCE, STEP_TOLERANCE = 1e-13, 1e-9

# Stiffness of a closed point relative to the surrounding nodes up to which multigrid solves body
# and joints in few iterations. The second value is for joint points that are not at nodes.
STIFF_AT_NODES, STIFF_ELSEWHERE = 1e3, 10.0

# Share of the diagonal of A from which joints need separate levels, cut from the tied body.
TIED_STIFFNESS = 5.0

# Share of the diagonal added for basis functions that are cut to few nodes and linearly dependent;
# basis functions of the body are not affected.
CUT_REGULARISATION = 1e-10
