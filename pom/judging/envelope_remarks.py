"""Remarks on a run that leaves the flown region of its model, from its envelope outputs.

A model of this program states at every sample how far flights support it (`flightmech.envelope`).
Flown and between flown points are the regions of high and moderate confidence of 14 CFR Part 60,
Appendix A, Attachment 7; a-priori is that of low confidence.  A case there proves the model where
no flight identified it, which is a notice and no fault.  Beyond the tables the model holds its last
values: the envelope is left, which is a departure.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from flightmech.envelope.regions import A_PRIORI, EXTRAPOLATED, axis_name
from pom.judging.watched_channels import SLOWEST
from pom.tolerances.bands import RowRemark

REGION, AXIS = "envelope.region", "envelope.axis"
"""Outputs of a model with an envelope."""
LEAST_SHARE = 0.01  # of the samples of a run; our number: a touch of an edge has no consequence
_WORDS = {
    A_PRIORI: ("low_confidence", "low confidence: a-priori, supported by no flight"),
    EXTRAPOLATED: ("envelope_left", "envelope left: extrapolated beyond the tables"),
}


def envelope_remarks(
    time: np.ndarray, outputs: Mapping[str, np.ndarray], on_wheels: np.ndarray | None = None
) -> tuple[RowRemark, ...]:
    """Return a remark for each of the regions a-priori and extrapolated that a run enters.

    Parameters
    ----------
    time : array (time,)
        [s]
    outputs : mapping of str to array (time,)
        Of one run, with `REGION` and `AXIS`.  Without them there is no remark.  Samples at an
        airspeed ``V`` below 15 m/s are left out.
    on_wheels : array of bool (time,), optional
        Samples at which the flight had a wheel on the ground.  They are left out, since wheels and
        not the air hold the aeroplane there.

    Returns
    -------
    tuple of RowRemark
        ``low_confidence`` and ``envelope_left``, with the share of the time, the axes that left and
        the first time.  A share below `LEAST_SHARE` has no remark.
    """
    if not {REGION, AXIS} <= set(outputs) or time.size < 2:
        return ()
    region, axis = np.asarray(outputs[REGION]), np.asarray(outputs[AXIS])
    # a sample stands for half of the step on either side; at rest flow angles have no meaning
    weight = np.gradient(time)
    if "V" in outputs:
        weight = np.where(np.asarray(outputs["V"]) > SLOWEST, weight, 0.0)
    if on_wheels is not None:
        weight = np.where(on_wheels, 0.0, weight)
    if not weight.sum() > 0.0:
        return ()
    remarks = []
    for code, (kind, words) in _WORDS.items():
        inside = (region == code) & (weight > 0.0)
        share = float(weight[inside].sum() / weight.sum())
        if share < LEAST_SHARE:
            continue
        names = _leaving(axis[inside])
        by = f" by {', '.join(names)}" if names else ""
        text = (
            f"{words}, in {100.0 * share:.0f} % of the time{by}, first at {time[inside][0]:.1f} s"
        )
        if code == A_PRIORI and not names:
            # the model has no names of terms; a constant leaves by no axis
            text += "; a term without a state may cause it, 'aeromatch db envelope' names it"
        quantity = names[0] if names else ""
        remarks.append(RowRemark(kind, text, quantity, values={"share": share}, unit="1"))
    return tuple(remarks)


def _leaving(codes: np.ndarray) -> list[str]:
    """Return the names of axis codes, the most frequent first."""
    present, counts = np.unique(codes[codes > 0], return_counts=True)
    return [axis_name(int(present[k])) for k in np.argsort(-counts, kind="stable")]
