# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checks of inputs: where, which input, the result, and the test of the check.

"All readers" are the readers of meshes `read_msh`, `read_mesh`, `read_xdmf`, `split_mesh`,
`mesh_from_arrays` and `read_split`; a STEP file becomes a `.msh` file. "All formats" are the
formats of records PEER AT2, ESM, K-NET, COSMOS, SMC and plain columns.
"""

from typing import NamedTuple


class Check(NamedTuple):
    """Check of an input, with the file and name of its test."""

    where: str
    given: str
    result: str
    file: str
    test: str


CHECKS = (
    Check(
        "all readers",
        "duplicate cells, cells without volume, facets of more than two cells",
        "error with place",
        "mesh/test_mesh_checks.py",
        "test_wrong_cells_are_refused_with_their_place",
    ),
    Check(
        "all readers",
        "unconnected boundary facets that touch",
        "warning",
        "mesh/test_mesh_checks.py",
        "test_faces_that_touch_and_are_not_connected_are_warned_of",
    ),
    Check(
        "all readers",
        "cells turned inside out, other kinds of cells, a surface in 3-D",
        "error",
        "mesh/test_dolfinx_mesh.py",
        "test_a_curved_cell_turned_inside_out_is_refused",
    ),
    Check(
        "all readers",
        "no communicator",
        "error",
        "mesh/test_gmsh_file.py",
        "test_readers_need_a_communicator",
    ),
    Check(
        "read_msh",
        "groups of the same name",
        "one group",
        "mesh/test_mesh_checks.py",
        "test_groups_of_one_name_are_one_group",
    ),
    Check(
        "read_msh",
        "facets or cells in unnamed groups",
        "warning",
        "mesh/test_mesh_checks.py",
        "test_facets_of_groups_without_a_name_are_warned_of",
    ),
    Check(
        "read_msh",
        "truncated or partitioned files, wrong counts, both faces of a crack in one group",
        "error",
        "mesh/test_gmsh_file.py",
        "test_wrong_counts_are_refused",
    ),
    Check(
        "read_msh, arrays",
        "a group inside the body with a name similar to a joint's",
        "warning",
        "mesh/test_mesh_checks.py",
        "test_misspelt_joints_are_warned_of",
    ),
    Check(
        "read_mesh",
        "mixed cells, labels that are not defined or defined twice, generated nodes, several parts",
        "error",
        "mesh/test_other_programs.py",
        "test_mistakes_in_a_file_are_one_error",
    ),
    Check(
        "read_mesh",
        "other elements, empty sets, node sets without facets",
        "warning",
        "mesh/test_other_programs.py",
        "test_what_is_not_read_is_reported",
    ),
    Check(
        "read_xdmf",
        "facets of another mesh, reordered nodes, mixed cells",
        "error",
        "mesh/test_mesh_checks.py",
        "test_tagged_facets_are_those_of_the_mesh",
    ),
    Check(
        "read_xdmf",
        "several attributes, tags at nodes or that are not whole numbers",
        "chosen by name or gmsh:physical, else error",
        "mesh/test_xdmf_file.py",
        "test_tags_are_chosen_among_attributes",
    ),
    Check(
        "read_xdmf",
        "a facet with two tags",
        "in both groups",
        "mesh/test_mesh_checks.py",
        "test_a_facet_with_two_tags_is_in_both_groups",
    ),
    Check(
        "arrays, read_xdmf",
        "nodes without a cell",
        "removed",
        "mesh/test_arrays.py",
        "test_nodes_without_a_cell_are_left_out",
    ),
    Check(
        "STEP",
        "solids nearly in contact",
        "joined if very near, else reported",
        "geometry/test_step.py",
        "test_solids_that_nearly_touch",
    ),
    Check(
        "STEP",
        "implausible mesh size, unit or extent",
        "error or warning",
        "geometry/test_step.py",
        "test_solids_that_do_not_fit",
    ),
    Check(
        "Model",
        "values in other units, water far above the crest",
        "warning",
        "model/test_plausibility.py",
        "test_a_mesh_in_millimetres_and_the_switch",
    ),
    Check(
        "Model",
        "temperatures in kelvin and °C",
        "warning",
        "model/test_plausibility.py",
        "test_kelvin_beside_celsius",
    ),
    Check(
        "Model",
        "an uplift or form without force, water below its joint",
        "warning; error for ufl.ds(5) without tags",
        "model/test_plausibility.py",
        "test_loads_on_nothing",
    ),
    Check(
        "Model",
        "a component both fixed and prescribed",
        "error",
        "body/test_supports.py",
        "test_places_that_do_not_fit_are_refused",
    ),
    Check(
        "Model",
        "a law for a mesh without joints",
        "error",
        "model/test_model.py",
        "test_missing_and_unknown_joints",
    ),
    Check(
        "loads, springs, ds",
        "facets inside the body",
        "error",
        "mesh/test_mesh_checks.py",
        "test_integrals_over_ds_are_on_the_boundary",
    ),
    Check(
        "grout",
        "a pressure in other units",
        "warning",
        "model/test_plausibility.py",
        "test_grout_pressures_in_other_units",
    ),
    Check(
        "statics",
        "absent blocks that are the whole body or a part of a block",
        "error",
        "simulation/test_unfinished.py",
        "test_what_does_not_stand_is_refused",
    ),
    Check(
        "dynamics",
        "a step longer than the samples of a motion or wave",
        "high frequencies removed; warning above 1 %",
        "loads/test_loads.py",
        "test_long_steps_read_no_high_frequency_as_a_low_one",
    ),
    Check(
        "all formats",
        "placeholders for missing samples",
        "error with line",
        "motions/test_formats.py",
        "test_fillers_are_refused_in_every_format",
    ),
    Check(
        "all formats",
        "velocities or displacements",
        "error",
        "motions/test_formats.py",
        "test_displacements_and_velocities_are_no_accelerations",
    ),
    Check(
        "all formats",
        "wrong counts, text among numbers, unknown units, more than 20 g",
        "error with line",
        "motions/test_formats.py",
        "test_a_wrong_count_is_an_error",
    ),
    Check(
        "plain columns",
        "units in comments and names",
        "read; error for velocities, displacements or two units",
        "motions/test_columns.py",
        "test_units_in_comments_are_those_of_the_samples",
    ),
    Check(
        "plain columns",
        "times or line numbers among wrapped lines",
        "error with line",
        "motions/test_columns.py",
        "test_wrapped_lines_hold_samples_alone",
    ),
    Check(
        "plain columns",
        "a missing row",
        "error with line",
        "motions/test_columns.py",
        "test_a_missing_row_is_found",
    ),
    Check(
        "plain columns",
        "names above the numbers, decimal commas, rounded times, wrapped lines",
        "read",
        "motions/test_columns.py",
        "test_columns_of_many_programs_are_read",
    ),
    Check(
        "plain columns",
        "columns, unit or step that contradict the file",
        "error",
        "motions/test_columns.py",
        "test_what_is_missing_or_contradicts_is_an_error",
    ),
    Check(
        "read_record",
        "an implausible peak or time step",
        "warning",
        "motions/test_columns.py",
        "test_peaks_and_steps_of_no_record_are_warned_of",
    ),
    Check(
        "temperature_from_file",
        "blank cells, ragged rows, placeholders; points in another unit",
        "error with line; warning",
        "loads/test_temperature_fields.py",
        "test_malformed_files",
    ),
    Check(
        "spectra",
        "samples along the second axis",
        "error",
        "motions/test_spectra.py",
        "test_wrong_arguments_have_a_message",
    ),
    Check(
        "spectra",
        "peaks between samples and after the last one",
        "counted",
        "motions/test_spectra.py",
        "test_peaks_between_samples_and_after_the_motion_count",
    ),
    Check(
        "tables, terminal",
        "formulas and control characters in names",
        "made harmless",
        "export/test_csv_tables.py",
        "test_texts_of_files_are_no_formulas_and_no_escapes",
    ),
    Check(
        "results",
        "damaged, foreign or older files",
        "error that states which",
        "results/test_results.py",
        "test_foreign_files_are_errors",
    ),
    Check(
        "kernels",
        "a compilation that was killed",
        "removed, compiled again",
        "mesh/test_killed_compilations.py",
        "test_only_killed_compilations_are_removed",
    ),
)
