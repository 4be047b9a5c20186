# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cases that gradients do not include are refused with one sentence that names the case."""

import numpy as np
import pytest

pytest.importorskip("dolfinx")
from recorded_blocks import GAPS, LAW, POINTS, blocks, motion, recorded, shaken

import dolfinx_joints as dj

END = dj.Quantity.at_end("middle", 0)


def tape_of(model, **options):
    tape = dj.Tape(POINTS, gaps=GAPS)
    return tape, dj.Simulation(model, monitors=[tape], **options)


@pytest.mark.parametrize(
    ("law", "kind"),
    [
        (dj.RigidJoint(friction_angle_deg=30.0, stiffness_ratio=1.0), "RigidJoint"),
        (dj.ViscousJoint(law=LAW, normal_viscosity=1e5), "ViscousJoint"),
        (
            dj.MohrCoulombJoint(
                normal_stiffness=5e9,
                shear_stiffness=5e9,
                friction_angle_deg=30.0,
                cohesion=1e5,
                tensile_strength=1e5,
            ),
            "MohrCoulombJoint",
        ),
    ],
)
def test_laws(law, kind):
    with pytest.raises(dj.JointsError, match=f"'j' has the law {kind}; gradients support"):
        tape_of(blocks(law))


@pytest.mark.parametrize(
    ("options", "case"),
    [
        ({"damping": dj.ModalRatios(ratio=0.05, modes=3)}, "The damping has ratios of modes"),
        ({"loads": [dj.Gravity(), dj.JointWater(joint="j", level=2.0)]}, "Water follows"),
        ({"body": dj.Body(symmetric=False)}, "Matrices are unsymmetric"),
    ],
)
def test_models(options, case):
    _, run = tape_of(blocks(**options))
    with pytest.raises(dj.JointsError, match=case):
        run.dynamics(dt=1e-3, steps=1, motion=motion)


@pytest.mark.parametrize(
    "scheme", [dj.HilberHughesTaylor(), dj.ImplicitContact(), dj.EnergyConsistent(exact_modes=3)]
)
def test_schemes(scheme):
    _, run = tape_of(blocks())
    run.statics()
    with pytest.raises(dj.JointsError, match="gradients need EnergyConsistent without exact modes"):
        run.dynamics(dt=1e-3, steps=1, motion=motion, scheme=scheme)


def test_motion_that_differs_between_supports():
    record = dj.Motion(acceleration=np.outer(np.arange(9.0), [1.0, 0.0, 0.0]), dt=1e-3)
    places = {"left": (0.0, 0.0, 0.0), "right": (2.0, 0.0, 0.0)}
    differing = dj.DifferingMotion(motions=dict.fromkeys(places, record), positions=places)
    _, run = tape_of(blocks())
    run.statics()
    with pytest.raises(dj.JointsError, match="The motion differs between supports"):
        run.dynamics(dt=1e-3, steps=2, motion=differing)


def test_stages(tmp_path):
    _, run = tape_of(blocks())
    run.statics()
    with pytest.raises(dj.JointsError, match="The stage 'grouting 1' is not one of statics"):
        run.grout(["j"])

    _, run = tape_of(blocks())
    run.statics()
    end = run.dynamics(dt=1e-3, steps=2, motion=motion).state
    with pytest.raises(dj.JointsError, match="A second dynamic stage follows"):
        run.dynamics(dt=1e-3, steps=2, start=end)
    with pytest.raises(dj.JointsError, match="A static stage follows a dynamic stage"):
        run.statics()

    first = dj.Simulation(blocks())
    first.statics()
    first.save_static(tmp_path / "static.h5")
    _, run = tape_of(blocks())
    run.load_static(tmp_path / "static.h5")
    with pytest.raises(dj.JointsError, match="does not start from the unloaded body"):
        run.dynamics(dt=1e-3, steps=2, motion=motion)


def test_stages_of_other_functions():
    _, run = tape_of(blocks())
    run.statics()
    gap = dj.ControlledGap(joint="j")
    with pytest.raises(dj.JointsError, match="'controlled statics 1, 1' is not one of statics"):
        dj.controlled_statics(run, [-1e-6], loads=run.model.loads, quantity=gap)
    tape = dj.Tape(POINTS)
    with pytest.raises(dj.JointsError, match="'factor of safety' is not one of statics"):
        dj.factor_of_safety(run, monitors=[tape])


def test_restart(tmp_path):
    path = tmp_path / "run.h5"
    arguments = {"dt": 1e-3, "steps": 4, "motion": motion}
    _, run = tape_of(blocks())
    run.statics()
    run.dynamics(**arguments, checkpoint=dj.Checkpoints(path, every=2))
    _, run = tape_of(blocks())
    with pytest.raises(dj.JointsError, match="continues from a checkpoint"):
        run.dynamics(**arguments, checkpoint=dj.Checkpoints(path, every=2, resume=True))


def test_solver():
    _, run = tape_of(blocks(), solver="monolithic")
    with pytest.raises(dj.JointsError, match="The solver is 'monolithic'; gradients need"):
        run.statics()


def test_initial_overlap():
    law = dj.Joints(LAW, initial_gaps={"j": -1e-6})
    _, run = tape_of(blocks(law))
    with pytest.raises(dj.JointsError, match="Initial overlaps load the body"):
        run.statics(steps=2)


def test_another_path_than_one_step_of_the_law():
    """Change the history, as a solver that follows another path would."""
    tape = recorded(shaken(steps=20), blocks())
    tape.states[10] = tape.states[10] + np.array([0, 0, 0, 1e-6, 0, 0, 0, 0, 0, 0])
    with pytest.raises(dj.JointsError, match="is not one step of the joint laws"):
        dj.gradient_of(tape, END)


def test_singular_steps():
    """Let a frictionless block slide: its displacement along the joint has no derivative."""
    model = blocks(dj.frictionless(normal_stiffness=5e9))
    tape = recorded(lambda m, t: dj.Simulation(m, monitors=[t]).statics(), model)
    assert dj.gradient_of(tape, END).value < 0.0
    with pytest.raises(dj.JointsError, match="a block can move freely"):
        dj.gradient_of(tape, dj.Quantity.at_end("top", 0))


def test_arguments():
    with pytest.raises(ValueError, match="observes nothing"):
        dj.Tape()
    with pytest.raises(ValueError, match="name of a point and of a gap"):
        dj.Tape({"a": (0.0, 0.0)}, gaps={"a": "j"})
    with pytest.raises(dj.JointsError, match="'k'"):
        dj.Simulation(blocks(), monitors=[dj.Tape(gaps={"a": "k"})])
    with pytest.raises(ValueError, match="gap 'a'"):
        dj.Tape(gaps={"a": ("j", (0.0, np.nan))})
    with pytest.raises(ValueError, match="gap 'a'"):
        dj.Tape(gaps={"a": 3})
    tape, run = tape_of(blocks())
    with pytest.raises(dj.JointsError, match="The tape is empty"):
        dj.gradient_of(tape, END)
    with pytest.raises(dj.JointsError, match="give each Simulation a new Tape"):
        dj.Simulation(blocks(), monitors=[tape])
    late = dj.Simulation(blocks())
    late.monitors.append(dj.Tape(POINTS))
    with pytest.raises(dj.JointsError, match="A Tape was added to a simulation; give it to"):
        late.statics()
    run.statics()
    with pytest.raises(ValueError, match="quantity"):
        dj.gradient_of(tape, lambda history: 0.0)
    with pytest.raises(ValueError, match="'side' is not observed; the names are top, middle"):
        dj.gradient_of(tape, dj.Quantity(value=lambda h: 0.0, derivative=lambda h: {"side": 0.0}))
    with pytest.raises(ValueError, match="must be finite numbers of shape"):
        dj.gradient_of(tape, dj.Quantity(value=lambda h: 0.0, derivative=lambda h: {"top": 0.0}))
    with pytest.raises(ValueError, match="'side' is not observed; the names are top, middle"):
        dj.gradient_of(tape, dj.Quantity.at_end("side", 0))
    for value in (np.nan, None, np.zeros(3)):
        with pytest.raises(ValueError, match="value of the quantity is"):
            dj.gradient_of(tape, dj.Quantity(value=lambda h, v=value: v, derivative=lambda h: {}))
    for weights in (None, np.zeros((1, 3)), {"top": [[1j, 0, 0]]}, {"top": [["a", "b", "c"]]}):
        with pytest.raises(ValueError, match="The derivative"):
            dj.gradient_of(tape, dj.Quantity(value=END.value, derivative=lambda h, w=weights: w))
    with pytest.raises(ValueError, match="gap 'a' is .* it must be 2 finite numbers"):
        dj.Simulation(blocks(), monitors=[dj.Tape(gaps={"a": ("j", (0.0, 1.0, 0.0))})])
    with pytest.raises(ValueError, match="component"):
        dj.Quantity.at_end("top", 3)

    def statics(model, tape):
        dj.Simulation(model, monitors=[tape]).statics()

    with pytest.raises(ValueError, match="'cohesion' is not a parameter; the gradient contains"):
        dj.taylor_test(statics, tape, END, {"cohesion": {"j": 1.0}})
    with pytest.raises(dj.JointsError, match="no joint 'k'"):
        dj.taylor_test(statics, tape, END, {"normal_stiffness": {"k": 1.0}})
    for change in ({"j": "soft"}, np.ones(7), None):
        with pytest.raises(ValueError, match="The change of 'normal_stiffness'"):
            dj.taylor_test(statics, tape, END, {"normal_stiffness": change})
    for factor in ("large", np.nan, {"j": 1.0}):
        with pytest.raises(ValueError, match="The change of 'Gravity' is .* a finite number"):
            dj.taylor_test(statics, tape, END, {"Gravity": factor})
    with pytest.raises(ValueError, match="normal_stiffness"):
        dj.taylor_test(statics, tape, END, {"normal_stiffness": {"j": -6e9}})
    for sizes in ([0.5, 1.0], "ab", [1.0, np.nan], [1.0]):
        with pytest.raises(ValueError, match="sizes"):
            dj.taylor_test(statics, tape, END, {"normal_stiffness": {"j": 1.0}}, sizes=sizes)
    with pytest.raises(ValueError, match="change is 'mu'; it must be changes by name"):
        dj.taylor_test(statics, tape, END, "mu")
    with pytest.raises(dj.JointsError, match="The tape is empty"):
        dj.taylor_test(statics, dj.Tape(POINTS), END, {})
