# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Thresholds of the solvers: tolerances, sizes at which a method changes, limits of iterations.

Each comment says what a value trades and where it comes from; `tests/solvers/test_limits.py` names
the test or the page that shows its effect. Options of the user are in `SolverOptions`, options of
PETSc next to the solvers that they set. Read a value as ``limits.NAME``, so that a test can replace
it; compiled loops take it when they are compiled.
"""

import sys

# ROUNDING
EPSILON = sys.float_info.epsilon

# Rounding error of A x relative to |A| |x|, and of joint forces relative to the gaps that they
# follow from, which are sums over many dofs.
PRODUCT_ROUNDING, GAP_ROUNDING = 4.0 * EPSILON, 64.0 * EPSILON

# Error of a product in single precision, and what is rounding error of a direction of GMRES: some
# ten roundings of 6e-8.
SINGLE_ROUNDING = 1e-6

# Largest residual accepted as rounding error, relative to the forces: of joints some millions of
# times stiffer than the body; where rounding exceeds all joint forces, as of points that only just
# close as a step ends; and of forces of artificial springs, if blocks fall far before contact. The
# steps fail with smaller values; larger ones would accept errors, or mechanisms.
LARGEST_ROUNDING, LARGEST_CONTACT_ROUNDING, LARGEST_SPRING_ROUNDING = 1e-6, 1e-3, 1e-8

# Residual of unsupported blocks left to rounding, relative to the largest force: its correction
# would move blocks that can rest anywhere.
BALANCED = 1e-12

# Condition estimate |A| |x| / |f| for random forces f above which a tangent of statics is singular:
# two digits below the inverse of the rounding unit.
SINGULAR_GROWTH = 0.01 / EPSILON

# Relative residual of the first solve with a factor above which the matrix is singular: LU of such
# matrices may end without an error. It is stricter for K of blocks, since springs on a supported
# block do no harm.
FACTOR_RESIDUAL, SUPPORTED_RESIDUAL = 1e-2, 1e-6

# NEWTON'S METHOD
# If the residual is not below LEAST_FALL of the one PATIENCE iterations ago, WHOLE_CORRECTIONS
# corrections are taken whole: halved ones may creep towards a kink that is no solution.
PATIENCE, LEAST_FALL, WHOLE_CORRECTIONS = 5, 0.9, 2

# Part of the residual that the first corrections may leave: of the body by multigrid, of joint
# forces in time steps, and in statics, which have few solves. Smaller values take more products,
# larger ones more iterations.
BODY_FORCING, JOINT_FORCING, STATIC_FORCING = 0.1, 0.03, 3e-4

# Part of the accepted residual that later ones aim at, and of the residual that the last correction
# of the body may leave, so that the energy balances to rounding.
FORCING_MARGIN, POLISH = 0.3, 0.01

# The iteration on joint forces continues to this part of the tolerance if rounding allows it, since
# the energy balance depends on the residual; in statics to this part of the largest force.
END_OF_STEPS, END_OF_STATICS = 0.01, 1e-14

# An accepted residual is final if a correction leaves more than STALLED of it; entries below
# CONVERGED_ENTRIES of the target residual cost no product.
STALLED, CONVERGED_ENTRIES = 0.5, 0.1

# Corrections add the rounding error of single precision to S f. If it exceeds STALE of the
# residual, S f is computed anew; if it will exceed STALE_NEXT of the next residual, were
# convergence quadratic, the next S f is computed in double precision. Both are omitted if the error
# is below NEGLIGIBLE of the target residual; with W the true error was up to 8 times the estimate.
STALE, STALE_NEXT, NEGLIGIBLE = 0.1, 0.3, 0.03

# Parts of the closed joints' stiffness tried in turn where a tangent is singular: the smallest that
# makes it regular, because corrections are less exact with more.
REGULARISATIONS = (0.0, 1e-4, 1e-2)

# A static solution accepted for rounding changes by no more than this part in one more correction;
# that of a block without support does.
SETTLED = 1e-5

# STATICS OF JOINTS
# Times that a static solution is corrected by the gaps of the body: stiff joints turn the rounding
# errors of gaps into forces.
REFINEMENTS = 3

# Residual over the largest force up to which statics start on the line through the last two
# accepted states, which saves iterations under loads that grow in proportion.
ON_LINE = 1e-3

# A point that only its own spring supports has c s = 1, and 1 / (1 - c s) is infinite; any smaller
# product does as well.
SPRING_COMPLIANCE = 0.9

# Share of the artificial springs kept in the Newton matrix, which is singular without it if a block
# is open or frictionless. The equilibrium does not depend on it.
SPRING_REGULARISATION = 1e-6

# Added to the diagonal of I + T S if joints are rigid: the matrix is singular where points that
# stick tie each other, and corrections would follow the rounding error there.
RIGID_DAMPING = 1e-8

# Residuals of the step below which the opening of a rigid point is none: where rigid joints meet it
# would contradict the points that stick in all later steps.
RIGID_OPENING = 10.0

# 1/dt^2 of the first and the last step in pseudo-time relative to |K|/|M|, its fall in a step, and
# the most steps: other falls find fewer or as many equilibria.
PSEUDO_FIRST, PSEUDO_LAST, PSEUDO_FALL, PSEUDO_STEPS = 1e-2, 1e-15, 0.1, 20

# Where rounding leaves more inertia than the tolerance, the last step in pseudo-time changes no
# more than this part of x; on a mechanism it changes most of it.
PSEUDO_SETTLED = 1e-3

# CORRECTIONS OF JOINT FORCES
# Products that GMRES may spend on one correction; the correction found by then is used.
MOST_PRODUCTS = 100

# Products that a correction takes on average, to compare the costs of active set and complement.
TYPICAL_PRODUCTS = 10

# Finest tolerances of systems in single precision, and with S compressed to ROUGH_COMPRESSION:
# tighter ones are not reached and would spend all products.
FINEST_SINGLE, FINEST_COMPRESSED = 1e-5, 1e-3

# Part of its square that a new direction of GMRES keeps if one pass makes it orthogonal.
ORTHOGONAL_REST = 0.01

# Difference of T and T0, which are between 0 and 1, that is rounding: the point sticks.
SAME_TANGENT = 1e-12

# Entries read without W, over m^3, after which W is made. It costs 2.3 m^3 operations, five in the
# time of an entry in single precision, and is made when a quarter of that has been spent, because
# most runs are long.
COMPLEMENT_COST = 2.3 / 20.0

# Pivot of I + T0 S below which W is not used: points that stick tie each other, and W amplifies
# what corrections leave of their systems.
COMPLEMENT_PIVOT = 0.03

# Share of nonzero entries in a vector above which half of a symmetric S is read faster than the
# columns of these entries.
NONZERO_SHARE = 0.6

# Most points of a kept set: so many times the points wanted, and some more. Larger sets are renewed
# more rarely, but cost more in each product.
SET_EXCESS, SET_SPARE = 1.4, 20

# COMPLIANCE OF THE JOINTS
# Joint unknowns up to which the compliance is dense. Beyond, a compressed one is not only smaller,
# its products are also faster.
LARGEST_DENSE = 2000

# Joint unknowns up to which matrices of m^2 entries are made beside a compressed S: S in single
# precision, 0.15 GB over all ranks, and W, 0.3 GB.
LARGEST_WHOLE = 6000

# Joint unknowns from which all columns are made at once, which takes another factorization; and the
# error, relative to the largest entry, that is not rounding: MUMPS was seen to return wrong ones.
SMALLEST_AT_ONCE, AT_ONCE_ERROR = 300, 1e-8

# Points where the diagonal is solved for to scale an estimate, and columns that are compared.
SAMPLES = 8

# Columns that are solved for in a block: fewer read the factor more often, more gain nothing.
BLOCK_COLUMNS = 64

# Columns of the compliance in the time of a static solve without it: 250 products, and 7 columns of
# a block in the time of one back-substitution.
STATIC_SOLVE_COLUMNS = 1750

# Error of the compressed S relative to its unit diagonal, and of the one inside corrections, whose
# products take a fifth of the time.
COMPRESSION, ROUGH_COMPRESSION = 1e-12, 1e-4

# Points of the smallest clusters; 48 take as much memory and somewhat longer.
CLUSTER_POINTS = 96

# A block of low rank is tried where the smaller cluster's diameter is at most ADMISSIBLE_SIZE times
# the distance of the two, and kept where it takes at most LOW_RANK_SHARE of the dense one.
ADMISSIBLE_SIZE, LOW_RANK_SHARE = 4.0, 0.9

# Entries that the store of the blocks grows by: growing in place avoids a copy of all blocks.
STORE_GROWTH = 1_000_000

# Matrices kept, one per step length: on the condensed path as many as dense compliances fit into
# KEPT_BYTES, from FEWEST_KEPT to MOST_KEPT; of tangents TANGENTS_KEPT, FEWEST_KEPT if iterated.
KEPT_BYTES, FEWEST_KEPT, TANGENTS_KEPT, MOST_KEPT = 2_000_000_000, 2, 4, 8

# SOLVERS OF THE BODY
# Mean entries of a column of the factor up to which one in blocks of a node is faster, and rows of
# the matrix beyond which it pays late, for its set-up and columns of compliances.
NODE_BLOCK_COLUMN, NODE_BLOCK_ROWS = 150.0, 25_000

# Residual of multigrid relative to the right-hand side, as direct solvers leave it; and in linear
# steps, whose residual does no work in the step and is corrected in the next.
MULTIGRID_TOLERANCE, STEP_TOLERANCE = 1e-13, 1e-9

# Stiffness of a closed point relative to that of the nodes around it up to which multigrid solves
# body and joints in few iterations; of points at nodes, and of others, which tie no nodes.
STIFF_AT_NODES, STIFF_ELSEWHERE = 1e3, 10.0

# Part of the diagonal of A from which joints need levels of their own, cut from the tied body.
TIED_STIFFNESS = 5.0

# Part of their diagonal added to functions that are cut to few nodes and depend on each other. No
# function of the body sees it.
CUT_REGULARISATION = 1e-10
