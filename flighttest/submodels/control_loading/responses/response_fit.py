"""End of an output error on a circuit, with remarks on what it does not explain."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from flighttest.remarks import Convergence, Remark

# Standard errors from which on a nuisance is remarked; misfit over noise from which on it is.
_CERTAIN, _MISFIT = 3.0, 2.0
# What an output error cannot check: its friction has no travel over which it develops.
_DIVISION = (
    "not checked: how the mass is divided between cockpit and surface. Friction that builds up "
    "over a small travel, which the model does not have, moved the mass of the cockpit end by -19 "
    "% and the inertia of the surface by 17 % on simulated pedals, beyond the standard errors, and "
    "their sum by -2 %. Compare the two with drawings"
)


@dataclass(frozen=True)
class ResponseFit:
    """Output error on a circuit.

    Attributes
    ----------
    convergence : Convergence
        End of the search.
    windows : int
        Windows of free motion.
    rms : dict of str to float
        Residual of ``travel`` and ``surface`` over the white noise of their pick-ups.
    hand_damping : (float, float)
        Force over rate that driven records lack compared with free motion, and its standard error.
    widths : dict of str to (float, float)
        Rate at which friction is developed to 76 %, and travel at which the preload is, with their
        standard errors. [m/s and m, of the wheel rad/s and rad]
    held : tuple of str
        Windows of free motion whose starts were held, by number and time.
    """

    convergence: Convergence
    windows: int
    rms: Mapping[str, float]
    hand_damping: tuple[float, float]
    widths: Mapping[str, tuple[float, float]]
    held: tuple[str, ...] = ()

    @property
    def remarks(self) -> list[Remark]:
        """Remarks on a force that driven and free motion do not share, on the misfit, and on the
        division of the mass, which no record of this kind checks.
        """
        remarks = self.convergence.remarks(
            "output error of the circuit",
            "the likelihood still rises; give records with more motion, fewer terms, or drawings",
            severity="warning",
        )
        if self.held:
            text = (
                f"the starts of {len(self.held)} of {self.windows} windows of free motion are "
                f"held, where friction stops their search: {', '.join(self.held)}; the constants "
                f"are at their maximum with free starts too, within 0.3 standard errors"
            )
            if not self.convergence.converged:
                text = text.partition(";")[0]
            remarks.append(Remark("held starts", text, severity="note"))
        value, stderr = self.hand_damping
        if abs(value) > _CERTAIN * stderr:
            text = (
                f"driven records have {value:.3g} +- {stderr:.2g} N per m/s less damping than free "
                f"motion: their force lacks a part proportional to the rate; damping is that of "
                f"free motion. Check filter and time of the force transducer"
            )
            remarks.append(
                Remark(
                    "disturbance",
                    text,
                    "damping",
                    value=value,
                    threshold=_CERTAIN * stderr,
                    severity="note",
                )
            )
        worst = max(self.rms, key=lambda name: self.rms[name])
        if self.rms[worst] > _MISFIT:
            text = (
                f"free motion: {worst} differs from its simulation by {self.rms[worst]:.2g} times "
                f"the noise of its pick-up; the standard errors contain the difference. Check the "
                f"times at which the force changes, and stops"
            )
            remarks.append(
                Remark(
                    "unexplained",
                    text,
                    worst,
                    value=self.rms[worst],
                    threshold=_MISFIT,
                    severity="note",
                )
            )
        remarks.append(Remark("division", _DIVISION, "mass", severity="note"))
        return remarks
