# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Exceptions and warnings of this package; each message states what the user can do."""

import sys
import warnings
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial, wraps
from typing import Any, TypeVar

from dolfinx_joints.common.parameters import printable

# Modules whose frames may be between the user's line and a warning.
_PASSED = ("dolfinx_joints", "contextlib", "dataclasses", "functools")

# Public names of earlier versions, removed arguments by class or function, and replacements.
REMOVED_NAMES = {"ReducedBulk": "omit reduced=, all steps solve for the whole body"}
_OF_BODY = "degree plane extra_stiffness extra_mass extra_damping symmetric redistribute_mass"
REMOVED_ARGUMENTS = {
    "EnergyConsistent": {"spectral_radius": "use HilberHughesTaylor or GeneralizedAlpha"},
    "Model": {
        **{name: f"use joints=Joints(laws, {name}=...)" for name in ("initial_gaps", "quadrature")},
        **{name: f"use body=Body({name}=...)" for name in _OF_BODY.split()},
        **dict.fromkeys(("added_mass", "reservoir"), "use water=..."),
    },
    "dynamics": {
        "reduced": "omit it, all steps solve for the whole body",
        **{n: f"use start=InitialFields({n}=...)" for n in ("velocity", "displacement")},
        "resume": "use checkpoint=Checkpoints(path, resume=...)",
    },
}

T = TypeVar("T", bound=Callable[..., Any])


def warn(text: str, category: type[Warning] = UserWarning) -> None:
    """Warn at the user's line, the first one outside this package.

    Python's ``skip_file_prefixes`` does not work here: constructors of dataclasses are in a file
    ``<string>``, and the user's line may be as well.
    """
    level, frame = 1, sys._getframe()
    while frame.f_back and frame.f_globals.get("__name__", "").partition(".")[0] in _PASSED:
        level, frame = level + 1, frame.f_back
    warnings.warn(text, category, stacklevel=level)


def doubt(comm: Any, *texts: str) -> None:
    """Warn of implausible values, on rank 0."""
    for text in texts if comm.rank == 0 else ():
        warn(text, PlausibilityWarning)


def refuse_removed_name(name: str) -> None:
    """Raise an AttributeError if a public name was removed."""
    if name in REMOVED_NAMES:
        raise AttributeError(f"{name} was removed; {REMOVED_NAMES[name]}.")


def refuses_removed(of: T) -> T:
    """Make a class or function raise a TypeError for its removed arguments.

    Put the decorator above ``@dataclass`` of a class, or below ``@checked`` of a function.
    """
    is_class, removed = isinstance(of, type), REMOVED_ARGUMENTS[of.__name__]
    call = of.__init__ if is_class else of  # type: ignore[misc]

    @wraps(call)
    def refuse(*args: Any, **kwargs: Any) -> Any:
        for name in removed.keys() & kwargs:
            raise TypeError(f"{name} was removed; {removed[name]}.")
        return call(*args, **kwargs)

    if not is_class:
        return refuse  # type: ignore[return-value]
    of.__init__ = refuse  # type: ignore[misc]
    return of


class JointsError(Exception):
    """Base class of the exceptions of this package."""

    def __str__(self) -> str:
        """Return the message without control characters, which names from files may contain."""
        return printable(super().__str__())


class RecordError(JointsError, ValueError):
    """Error in a ground-motion file or motion."""


class MeshError(JointsError, ValueError):
    """Error in a mesh, a named group or a joint surface."""


class ResultsError(JointsError, ValueError):
    """Error in a results file or in a request for its content."""


class CheckpointError(JointsError, ValueError):
    """Error in writing a checkpoint or in continuing a run from one."""


class OtherRunError(CheckpointError):
    """Error for a checkpoint or results file that belongs to a different model or run."""


class TemperatureError(JointsError, ValueError):
    """Error in a file of temperatures."""


class StudyError(JointsError, ValueError):
    """Error in a study, its table or one of its rows."""


class PlausibilityWarning(UserWarning):
    """Warning of a value that is implausible for a dam or that a run does not resolve.

    Often the value is not in SI units. For models in other units, use
    ``warnings.simplefilter("ignore", PlausibilityWarning)``.
    """


@dataclass(kw_only=True, eq=False, repr=False)
class ConvergenceError(JointsError, RuntimeError):
    """Error for a solve that did not converge.

    Every argument is optional and becomes an attribute of the same name. The message contains the
    given arguments.

    Args:
        stage: Kind of the stage, for example ``"static"`` or ``"earthquake"``.
        name: Name of a static stage in results.
        step: Number of the step within the stage.
        time: Time at the end of the step [s].
        reached: Load factor of the last equilibrium, from 0 for the loads before the ramp or time
            step to 1 for the loads at its end.
        iteration: Number of iterations.
        residual: Norm that was compared with ``tolerance``.
        tolerance: Largest accepted residual.
        open: Number of open joint points at the last iteration.
        stick: Number of sticking joint points.
        slip: Number of sliding joint points.
        frictionless: Number of joint points that are closed without friction.
        joint: Name of the joint with the largest residual.
        yielding: Number of points of nonlinear cells whose internal variables change.
        law: Type of the law of ``joint``, or of the material without ``joint``, that returned NaN
            or infinity.
        remedy: Sentence that suggests a remedy.
    """

    stage: str | None = None
    name: str | None = None
    step: int | None = None
    time: float | None = None
    reached: float | None = None
    iteration: int | None = None
    residual: float | None = None
    tolerance: float | None = None
    open: int | None = None
    stick: int | None = None
    slip: int | None = None
    frictionless: int | None = None
    joint: str | None = None
    yielding: int | None = None
    law: str | None = None
    remedy: str | None = None

    def __post_init__(self) -> None:
        super().__init__(self._sentence())

    def __reduce__(self) -> tuple[Callable[[], "ConvergenceError"], tuple[()]]:
        """Return the data for pickling, with all attributes."""
        return partial(type(self), **asdict(self)), ()

    def _failure(self) -> str:
        beyond = "" if self.reached is None else f" beyond the load factor {self.reached:.4g}"
        return f"did not converge{beyond}"

    def _sentence(self) -> str:
        subject = "the solve" if self.stage is None else f"the {self.stage} stage"
        if self.name is not None:
            subject += f" {self.name!r}"
        if self.step is not None:
            subject += f", step {self.step},"
        if self.time is not None:
            subject += f" at t = {self.time:.6g} s"
        text = f"{subject} {self._failure()}"
        if self.iteration is not None:
            text += f" in {self.iteration} iteration{'' if self.iteration == 1 else 's'}"
        details = []
        if self.residual is not None:
            limit = "" if self.tolerance is None else f", tolerance {self.tolerance:.3g}"
            details.append(f"residual {self.residual:.3g}{limit}")
        states = (("open", self.open), ("stick", self.stick), ("slip", self.slip))
        counts = [f"{count} {name}" for name, count in states if count is not None]
        if self.frictionless:
            counts.append(f"{self.frictionless} closed without friction")
        if counts:
            details.append(f"joint points {', '.join(counts)}")
        if self.law is not None:
            of_joint = "" if self.joint is None else f" of joint {self.joint!r}"
            details.append(f"the law {self.law}{of_joint} returned NaN or infinity")
        elif self.joint is not None:
            details.append(f"worst joint {self.joint!r}")
        if self.yielding is not None:
            details.append(f"{self.yielding} yielding points of the bulk")
        text = text[0].upper() + text[1:]
        text = f"{text}{': ' if details else ''}{'; '.join(details)}."
        return text if self.remedy is None else f"{text} {self.remedy}"


@dataclass(kw_only=True, eq=False, repr=False)
class JumpError(ConvergenceError):
    """Error for a static stage in which the structure jumps to a distant equilibrium.

    Args:
        released: Energy released by the jump [J].
        joints: Names of the joints that release the energy, the largest share first.
    """

    released: float = 0.0
    joints: tuple[str, ...] = ()

    def _failure(self) -> str:
        where = f" in {', '.join(map(repr, self.joints))}" if self.joints else ""
        after = "" if self.reached is None else f" beyond the load factor {self.reached:.4g}"
        return f"jumps{after}: the next equilibrium releases {self.released:.4g} J{where}"
