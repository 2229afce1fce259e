"""Which signals a criterion is computed from."""

from __future__ import annotations

from .criteria import Criterion
from .derived_channels import sources
from .event_names import DISCRETES, LEVELS, OF_PARAMETER
from .row_conditions import asked


def needs(criterion: Criterion) -> tuple[str, ...]:
    """Return the quantities a criterion is computed from, formed ones among them."""
    match criterion.measure:
        case "peak_lag":
            return ("phi", "beta")
        case "segment_mean":
            return ("h",) if criterion.channel == "hdot" else (criterion.channel,)
        case "floor":
            return ("h", "V")
        case "curve" | "breakout" | "force_increment":
            return (criterion.channel, criterion.abscissa)
        case "scalar":
            return {"turn_radius": ("distance", "psi"), "trim_rate": (criterion.abscissa,)}.get(
                criterion.parameter, (criterion.channel, criterion.abscissa)
            )
        case "elapsed":
            return tuple(filter(None, (criterion.channel, criterion.abscissa, LEVELS.get(criterion.bounds[1], ("",))[0])))
    return (criterion.channel,)


def channels(criterion: Criterion) -> tuple[str, ...]:
    """Return the signals that a criterion is computed from; a model has to have them."""
    return tuple(dict.fromkeys(name for channel in needs(criterion) for name in sources(channel)))


def helpful(criterion: Criterion) -> tuple[str, ...]:
    """Return signals that show the events and conditions of a criterion; a model may have them."""
    event = OF_PARAMETER.get(criterion.parameter, "") if criterion.measure in ("event_value", "setup") else ""
    showing = [name for each in (event, *criterion.bounds) for name in (*DISCRETES.get(each, ()), *LEVELS.get(each, ())[:1])]
    flows = [f"engine{n}.fuel_flow" for n in range(1, 5)] if criterion.channel == "fuel_used" else []
    return tuple(dict.fromkeys(name for channel in (*showing, *asked(criterion.condition), *flows) for name in sources(channel)))
