# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Test of each input in the table "What is checked" of docs/guide/errors.md."""

TESTS = {
    "duplicate cells, cells without volume, facets of more than two cells": (
        "mesh/test_mesh_checks.py",
        "test_wrong_cells_are_refused_with_their_place",
    ),
    "unconnected boundary facets that touch": (
        "mesh/test_mesh_checks.py",
        "test_faces_that_touch_and_are_not_connected_are_warned_of",
    ),
    "cells turned inside out, other kinds of cells, a surface in space": (
        "mesh/test_dolfinx_mesh.py",
        "test_a_curved_cell_turned_inside_out_is_refused",
    ),
    "no communicator": (
        "mesh/test_gmsh_file.py",
        "test_readers_need_a_communicator",
    ),
    "groups of the same name": (
        "mesh/test_mesh_checks.py",
        "test_groups_of_one_name_are_one_group",
    ),
    "facets or cells in unnamed groups": (
        "mesh/test_mesh_checks.py",
        "test_facets_of_groups_without_a_name_are_warned_of",
    ),
    "truncated or partitioned files, wrong counts, both faces of a crack in one group": (
        "mesh/test_gmsh_file.py",
        "test_wrong_counts_are_refused",
    ),
    "a group inside the body with a name similar to a joint's": (
        "mesh/test_mesh_checks.py",
        "test_misspelt_joints_are_warned_of",
    ),
    "facets of another mesh, reordered nodes, mixed cells": (
        "mesh/test_mesh_checks.py",
        "test_tagged_facets_are_those_of_the_mesh",
    ),
    "several attributes, tags at nodes or that are not whole numbers": (
        "mesh/test_xdmf_file.py",
        "test_tags_are_chosen_among_attributes",
    ),
    "a facet with two tags": (
        "mesh/test_mesh_checks.py",
        "test_a_facet_with_two_tags_is_in_both_groups",
    ),
    "nodes without a cell": (
        "mesh/test_arrays.py",
        "test_nodes_without_a_cell_are_left_out",
    ),
    "solids nearly in contact": (
        "geometry/test_step.py",
        "test_solids_that_nearly_touch",
    ),
    "implausible mesh size, unit or extent": (
        "geometry/test_step.py",
        "test_solids_that_do_not_fit",
    ),
    "values in other units, water far above the crest": (
        "model/test_plausibility.py",
        "test_a_mesh_in_millimetres_and_the_switch",
    ),
    "temperatures in kelvin and °C": (
        "model/test_plausibility.py",
        "test_kelvin_beside_celsius",
    ),
    "an uplift or form without force, water below its joint": (
        "model/test_plausibility.py",
        "test_loads_on_nothing",
    ),
    "a component both fixed and prescribed": (
        "body/test_supports.py",
        "test_places_that_do_not_fit_are_refused",
    ),
    "a law for a mesh without joints": (
        "model/test_model.py",
        "test_missing_and_unknown_joints",
    ),
    "facets inside the body": (
        "mesh/test_mesh_checks.py",
        "test_integrals_over_ds_are_on_the_boundary",
    ),
    "a pressure in other units": (
        "model/test_plausibility.py",
        "test_grout_pressures_in_other_units",
    ),
    "absent blocks that are the whole body or a part of a block": (
        "simulation/test_unfinished.py",
        "test_what_does_not_stand_is_refused",
    ),
    "a step longer than the samples of a motion or wave": (
        "loads/test_loads.py",
        "test_long_steps_read_no_high_frequency_as_a_low_one",
    ),
    "placeholders for missing samples": (
        "motions/test_formats.py",
        "test_fillers_are_refused_in_every_format",
    ),
    "velocities or displacements": (
        "motions/test_formats.py",
        "test_displacements_and_velocities_are_no_accelerations",
    ),
    "wrong counts, text among numbers, unknown units, more than 20 g": (
        "motions/test_formats.py",
        "test_a_wrong_count_is_an_error",
    ),
    "units in comments and names": (
        "motions/test_columns.py",
        "test_units_in_comments_are_those_of_the_samples",
    ),
    "times or line numbers among wrapped lines": (
        "motions/test_columns.py",
        "test_wrapped_lines_hold_samples_alone",
    ),
    "a missing row": (
        "motions/test_columns.py",
        "test_a_missing_row_is_found",
    ),
    "names above the numbers, decimal commas, rounded times, wrapped lines": (
        "motions/test_columns.py",
        "test_columns_of_many_programs_are_read",
    ),
    "columns, unit or step that contradict the file": (
        "motions/test_columns.py",
        "test_what_is_missing_or_contradicts_is_an_error",
    ),
    "an implausible peak or time step": (
        "motions/test_columns.py",
        "test_peaks_and_steps_of_no_record_are_warned_of",
    ),
    "blank cells, ragged rows, placeholders; points in another unit": (
        "loads/test_temperature_fields.py",
        "test_malformed_files",
    ),
    "samples along the second axis": (
        "motions/test_spectra.py",
        "test_wrong_arguments_have_a_message",
    ),
    "peaks between samples and after the last one": (
        "motions/test_spectra.py",
        "test_peaks_between_samples_and_after_the_motion_count",
    ),
    "formulas and control characters in names": (
        "export/test_csv_tables.py",
        "test_texts_of_files_are_no_formulas_and_no_escapes",
    ),
    "damaged, foreign or older files": (
        "results/test_results.py",
        "test_foreign_files_are_errors",
    ),
    "a compilation that was killed": (
        "mesh/test_killed_compilations.py",
        "test_only_killed_compilations_are_removed",
    ),
}
