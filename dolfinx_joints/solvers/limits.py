# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Thresholds of the solvers: tolerances, sizes at which a method changes, limits of iterations.

Each comment states what a value trades off and where it comes from; `tests/solvers/test_limits.py`
names the test or the page that shows its effect. User options are in `SolverOptions`, PETSc options
next to the solvers that they set. Read a value as ``limits.NAME``, so that a test can replace it;
compiled loops read it when they are compiled.
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

# Largest residual accepted as rounding error, relative to the forces. The first is for joints some
# millions of times stiffer than the body. The second is for steps whose rounding error exceeds all
# joint forces, as at points that only just close. The third is for forces of artificial springs, if
# blocks fall far before contact. Steps fail with smaller values; larger ones would accept errors or
# mechanisms.
LARGEST_ROUNDING, LARGEST_CONTACT_ROUNDING, LARGEST_SPRING_ROUNDING = 1e-6, 1e-3, 1e-8

# Residual of unsupported blocks that is accepted as rounding error, relative to the largest force.
# Correcting it would move blocks that can rest anywhere.
BALANCED = 1e-12

# Condition estimate |A| |x| / |f| for random forces f above which a static tangent is singular: two
# digits below the inverse of the rounding unit.
SINGULAR_GROWTH = 0.01 / EPSILON

# Relative residual of the first solve with a factor above which the matrix is singular: LU of a
# singular matrix may end without an error. The second, stricter value detects unsupported blocks in
# K; springs on a supported block do no harm.
FACTOR_RESIDUAL, SUPPORTED_RESIDUAL = 1e-2, 1e-6

# NEWTON'S METHOD
# If the residual is not below LEAST_FALL times that of PATIENCE iterations ago, take
# WHOLE_CORRECTIONS full corrections. Halved ones may creep towards a kink that is no solution.
PATIENCE, LEAST_FALL, WHOLE_CORRECTIONS = 5, 0.9, 2

# Share of the residual that the first correction may leave: of the body by multigrid, of joint
# forces in time steps, and in statics. Smaller values take more products, larger ones more
# iterations; statics has few solves.
BODY_FORCING, JOINT_FORCING, STATIC_FORCING = 0.1, 0.03, 3e-4

# Share of the accepted residual that later corrections aim at. The last correction of the body
# leaves POLISH of the residual, so that the energy balances to rounding error.
FORCING_MARGIN, POLISH = 0.3, 0.01

# The iteration on joint forces continues to this share of the tolerance if rounding allows it,
# since the energy balance depends on the residual. In statics it is a share of the largest force.
END_OF_STEPS, END_OF_STATICS = 0.01, 1e-14

# An accepted residual is final if a correction leaves more than STALLED of it. Entries below
# CONVERGED_ENTRIES of the target residual are dropped and cost no product.
STALLED, CONVERGED_ENTRIES = 0.5, 0.1

# Corrections add the rounding error of single precision to S f. If the error exceeds STALE of the
# residual, S f is recomputed. If it will exceed STALE_NEXT of the next residual under quadratic
# convergence, the next S f is computed in double precision. Both are omitted if the error is below
# NEGLIGIBLE of the target residual. With W the true error was up to 8 times the estimate.
STALE, STALE_NEXT, NEGLIGIBLE = 0.1, 0.3, 0.03

# Shares of the closed joints' stiffness added to a singular tangent, tried in turn. The first one
# that makes it regular is used, because a larger share makes corrections less exact.
REGULARISATIONS = (0.0, 1e-4, 1e-2)

# One more correction changes a static solution that is accepted within rounding error by no more
# than this share. That of an unsupported block changes by more.
SETTLED = 1e-5

# STATICS OF JOINTS
# Number of corrections of a static solution by the gaps of the body. Stiff joints turn rounding
# errors of gaps into forces.
REFINEMENTS = 3

# Residual over the largest force up to which a static increment starts on the line through the last
# two accepted states. This saves iterations under loads that grow in proportion.
ON_LINE = 1e-3

# Largest product c s. A point that only its own spring supports has c s = 1, where 1 / (1 - c s) is
# infinite; any smaller product gives the same solution.
SPRING_COMPLIANCE = 0.9

# Share of the artificial springs kept in the Newton matrix, which is singular without it if a block
# is open or frictionless. The equilibrium does not depend on it.
SPRING_REGULARISATION = 1e-6

# Added to the diagonal of I + T S if joints are rigid. If sticking points tie each other, the
# matrix is singular, and corrections would amplify rounding error.
RIGID_DAMPING = 1e-8

# Multiple of the step's residual below which the opening of a rigid point is set to zero. Where
# rigid joints meet, the opening would contradict the sticking points in all later steps.
RIGID_OPENING = 10.0

# 1/dt^2 of the first and the last step in pseudo-time relative to |K|/|M|, its factor per step, and
# the largest number of steps. Other factors do not find more equilibria.
PSEUDO_FIRST, PSEUDO_LAST, PSEUDO_FALL, PSEUDO_STEPS = 1e-2, 1e-15, 0.1, 20

# Largest relative change of x in the last step in pseudo-time, if rounding leaves more inertia than
# the tolerance. On a mechanism most of x changes.
PSEUDO_SETTLED = 1e-3

# CORRECTIONS OF JOINT FORCES
# Largest number of products per correction by GMRES; the correction reached by then is used.
MOST_PRODUCTS = 100

# Average number of products per correction, to compare the costs of active set and complement.
TYPICAL_PRODUCTS = 10

# Finest tolerances of systems in single precision, and with S compressed to ROUGH_COMPRESSION.
# Tighter ones are not reached and would use up all products.
FINEST_SINGLE, FINEST_COMPRESSED = 1e-5, 1e-3

# Share of a new direction's square below which GMRES makes it orthogonal once more.
ORTHOGONAL_REST = 0.01

# Difference of T and T0, both between 0 and 1, that is rounding error: the point sticks.
SAME_TANGENT = 1e-12

# Number of entries read without W, over m^3, after which W is computed. W costs 2.3 m^3 operations;
# five take the time of an entry in single precision. It is computed when a quarter of that cost has
# been spent, because most runs are long.
COMPLEMENT_COST = 2.3 / 20.0

# Pivot of I + T0 S below which W is not used: sticking points tie each other, and W amplifies the
# residuals of corrections.
COMPLEMENT_PIVOT = 0.03

# Share of nonzero entries in a vector above which half of a symmetric S is read faster than the
# columns of these entries.
NONZERO_SHARE = 0.6

# Largest size of a kept set of points: SET_EXCESS times the required number plus SET_SPARE. Larger
# sets are renewed more rarely, but cost more in each product.
SET_EXCESS, SET_SPARE = 1.4, 20

# COMPLIANCE OF THE JOINTS
# Joint unknowns up to which the compliance is dense. Beyond, a compressed one takes less memory and
# its products are faster.
LARGEST_DENSE = 2000

# Joint unknowns up to which matrices of m^2 entries are stored next to a compressed S. These are S
# in single precision, 0.15 GB over all ranks, and W, 0.3 GB.
LARGEST_WHOLE = 6000

# Joint unknowns from which all columns are computed at once, by another factorization. Relative
# error above which they are rejected: MUMPS was seen to return wrong columns.
SMALLEST_AT_ONCE, AT_ONCE_ERROR = 300, 1e-8

# Points where the exact diagonal is computed to scale an estimate, and columns compared.
SAMPLES = 8

# Columns solved per block: fewer read the factor more often, more save no time.
BLOCK_COLUMNS = 64

# Compliance columns that take the time of a static solve without a stored compliance: 250 products,
# with 7 columns of a block in the time of one back-substitution.
STATIC_SOLVE_COLUMNS = 1750

# Error of the compressed S relative to its unit diagonal, and of the rougher one in corrections,
# whose products take a fifth of the time.
COMPRESSION, ROUGH_COMPRESSION = 1e-12, 1e-4

# Points of the smallest clusters; 48 take as much memory and somewhat longer.
CLUSTER_POINTS = 96

# A block of low rank is tried if the smaller cluster's diameter is at most ADMISSIBLE_SIZE times
# their distance. It is kept if it takes at most LOW_RANK_SHARE of the dense block's memory.
ADMISSIBLE_SIZE, LOW_RANK_SHARE = 4.0, 0.9

# Entries by which the array of all blocks grows: growing in place avoids a copy of all blocks.
STORE_GROWTH = 1_000_000

# Matrices kept, one per step length. The condensed solver keeps as many as dense compliances fit
# into KEPT_BYTES, from FEWEST_KEPT to MOST_KEPT. The monolithic one keeps TANGENTS_KEPT tangents,
# or FEWEST_KEPT if they are solved by iteration.
KEPT_BYTES, FEWEST_KEPT, TANGENTS_KEPT, MOST_KEPT = 2_000_000_000, 2, 4, 8

# SOLVERS OF THE BODY
# Mean entries per column of the factor up to which a factor in node blocks is faster. Beyond so
# many rows its set-up and the compliance columns cost too much.
NODE_BLOCK_COLUMN, NODE_BLOCK_ROWS = 150.0, 25_000

# Residual of multigrid relative to the right-hand side, as small as that of direct solvers. In
# linear steps it may be larger: it does no work in the step and is corrected in the next.
MULTIGRID_TOLERANCE, STEP_TOLERANCE = 1e-13, 1e-9

# Stiffness of a closed point relative to the surrounding nodes up to which multigrid solves body
# and joints in few iterations. The second value is for points between nodes, which tie no nodes.
STIFF_AT_NODES, STIFF_ELSEWHERE = 1e3, 10.0

# Share of the diagonal of A from which joints need separate levels, cut from the tied body.
TIED_STIFFNESS = 5.0

# Share of the diagonal added to functions that are cut to few nodes and depend on each other;
# functions of the body are not affected.
CUT_REGULARISATION = 1e-10
