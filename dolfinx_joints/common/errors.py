# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Exceptions and warnings of this package; each message is one sentence a user can act on."""

import sys
import warnings
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial, wraps
from typing import Any, TypeVar

from dolfinx_joints.common.parameters import printable

# Modules whose frames are between a user's line and a warning.
_PASSED = ("dolfinx_joints", "contextlib", "dataclasses", "functools")

# Public names of earlier versions, arguments by class or function, and what to do instead.
REMOVED_NAMES = {"ReducedBulk": "leave out reduced=, the whole body takes all steps"}
_OF_BODY = "degree plane extra_stiffness extra_mass extra_damping symmetric redistribute_mass"
REMOVED_ARGUMENTS = {
    "EnergyConsistent": {"spectral_radius": "use HilberHughesTaylor or GeneralizedAlpha"},
    "Model": {
        **{name: f"use joints=Joints(laws, {name}=...)" for name in ("initial_gaps", "quadrature")},
        **{name: f"use body=Body({name}=...)" for name in _OF_BODY.split()},
        **dict.fromkeys(("added_mass", "reservoir"), "use water=..."),
    },
    "dynamics": {
        "reduced": "leave it out, the whole body takes all steps",
        **{n: f"use start=InitialFields({n}=...)" for n in ("velocity", "displacement")},
        "resume": "use checkpoint=Checkpoints(path, resume=...)",
    },
}

T = TypeVar("T", bound=Callable[..., Any])


def warn(text: str, category: type[Warning] = UserWarning) -> None:
    """Warn at the user's line, the first one outside of this package.

    Python 3.12 has ``skip_file_prefixes`` for this, but constructors of dataclasses are in a file
    ``<string>``, as the user's line may be.
    """
    level, frame = 1, sys._getframe()
    while frame.f_back and frame.f_globals.get("__name__", "").partition(".")[0] in _PASSED:
        level, frame = level + 1, frame.f_back
    warnings.warn(text, category, stacklevel=level)


def doubt(comm: Any, *texts: str) -> None:
    """Warn of what is implausible, on rank 0."""
    for text in texts if comm.rank == 0 else ():
        warn(text, PlausibilityWarning)


def refuse_removed_name(name: str) -> None:
    """Raise an AttributeError if a public name was removed."""
    if name in REMOVED_NAMES:
        raise AttributeError(f"{name} was removed; {REMOVED_NAMES[name]}.")


def refuses_removed(of: T) -> T:
    """Make a class or function raise a TypeError for its removed arguments.

    The decorator is above ``@dataclass`` and below ``@checked`` of a function.
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
    """Base of every exception that this package raises on purpose."""

    def __str__(self) -> str:
        """Return the message, which may have names from files, for a terminal."""
        return printable(super().__str__())


class RecordError(JointsError, ValueError):
    """A ground-motion file or motion that cannot be used."""


class MeshError(JointsError, ValueError):
    """A mesh, a named group or a joint surface that cannot be used."""


class ResultsError(JointsError, ValueError):
    """A results file, or a request made to one, that cannot be used."""


class CheckpointError(JointsError, ValueError):
    """A checkpoint that cannot be written, or a run that cannot be continued from one."""


class OtherRunError(CheckpointError):
    """A checkpoint or results file of another model or run than the one that is to go on."""


class TemperatureError(JointsError, ValueError):
    """A file of temperatures that cannot be used."""


class StudyError(JointsError, ValueError):
    """A study, a row or a table of one that cannot be used."""


class PlausibilityWarning(UserWarning):
    """A value that no dam has, perhaps in another unit than SI, or that a run does not resolve.

    Of models in other units: ``warnings.simplefilter("ignore", PlausibilityWarning)``.
    """


@dataclass(kw_only=True, eq=False, repr=False)
class ConvergenceError(JointsError, RuntimeError):
    """A solve that did not converge.

    Every argument is optional and kept as an attribute of the same name; the message is built
    from those that are given.

    Args:
        stage: name of the stage, for example ``"static"`` or ``"earthquake"``.
        name: name that a static stage has in results.
        step: number of the step within the stage.
        time: time at the end of the step [s].
        reached: load factor that is in equilibrium, the share of the way from the loads before a
            ramp, or before a step in time, to those at its end.
        iteration: iterations done.
        residual: the norm that was compared with ``tolerance``.
        tolerance: largest residual accepted.
        open: number of open joint points at the last iteration.
        stick: number of sticking joint points.
        slip: number of sliding joint points.
        frictionless: number of joint points that are closed without friction.
        joint: name of the joint with the largest residual.
        yielding: number of points of plastic cells at their limit.
        law: kind of a joint law that gave numbers that are not finite, in ``joint``.
        remedy: what may help, one sentence.
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
        """Keep the attributes when the exception travels between processes."""
        return partial(type(self), **asdict(self)), ()

    def _what(self) -> str:
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
        text = f"{subject} {self._what()}"
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
            details.append(f"the law {self.law} of joint {self.joint!r} gave NaN or infinity")
        elif self.joint is not None:
            details.append(f"worst joint {self.joint!r}")
        if self.yielding is not None:
            details.append(f"{self.yielding} points of the bulk at their limit")
        text = text[0].upper() + text[1:]
        text = f"{text}{': ' if details else ''}{'; '.join(details)}."
        return text if self.remedy is None else f"{text} {self.remedy}"


@dataclass(kw_only=True, eq=False, repr=False)
class JumpError(ConvergenceError):
    """A static stage in which the structure jumps to a distant equilibrium.

    Args:
        released: Energy that the jump releases [J].
        joints: Names of the joints that release it, the largest share first.
    """

    released: float = 0.0
    joints: tuple[str, ...] = ()

    def _what(self) -> str:
        where = f" in {', '.join(map(repr, self.joints))}" if self.joints else ""
        after = "" if self.reached is None else f" beyond the load factor {self.reached:.4g}"
        return f"jumps{after}: the next equilibrium releases {self.released:.4g} J{where}"
