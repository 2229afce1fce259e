"""Pumps that move fuel from tank to tank, and ``transfer`` of ``[fuel]`` in the aircraft file.

::

    [fuel]
    mass = "400 kg"
    tank = [
        { name = "tip", position = [0.1, -5.0, 0.0], capacity = "60 kg", content = "50 kg" },
        { name = "left", position = [0.1, -2.0, 0.1], capacity = "200 kg", content = "175 kg" },
        { name = "right", position = [0.1, 2.0, 0.1], capacity = "200 kg", content = "175 kg" },
    ]
    transfer = [
        { source = "tip", target = "left", rate = "0.1 kg/s", on = true },
    ]
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

from pydantic import ConfigDict, Field

from flightmech.aircraft.propulsion.tank import Tank
from flightmech.support.toml_models import Strict
from flightmech.support.toml_quantities import InUnits

# Time in which a pump moves the fuel of its band, if the file gives no band. [s]
_BAND_TIME = 1.0
# Shortest such time: the float valve would flutter between two steps. [s]
_SHORTEST = 0.1
# Part of a capacity within which a content is the full tank.
_ROUNDING = 1e-9
# Transfers that a model holds.
_MOST_ITEMS = 16


@dataclass(frozen=True)
class Transfer:
    """A pump from a tank to a tank, with a float valve where it ends.

    It moves ``rate * max(0, min(1, (m_source - leave) / band, (fill - m_target) / band))`` while
    its input ``transfer.SOURCE.TARGET.pump`` is above 0.5.

    Parameters
    ----------
    source, target : str
        Names of the tanks.
    rate : float
        Flow of the pump. [kg s-1]
    fill : float
        Content of the target at which the float valve is shut. [kg]
    band : float
        Fuel over which the float valve shuts, and over which the pump runs dry. [kg]
    leave : float
        Fuel of the source that the pump does not reach. [kg]
    on : bool
        Whether the pump is on where nothing drives its input.
    """

    source: str
    target: str
    rate: float
    fill: float
    band: float
    leave: float = 0.0
    on: bool = False

    @property
    def item(self) -> str:
        """Name in the model, such as ``tip.left``."""
        return f"{self.source}.{self.target}"


def transfer_problems(transfers: Sequence[Transfer], tanks: Sequence[Tank]) -> Iterator[str]:
    """Yield the problems of pumps between these tanks."""
    if transfers and not tanks:
        yield "transfer needs tanks that feed engines; add tank to [fuel] and feed to [[engine]]"
        return
    if len(transfers) > _MOST_ITEMS:
        yield f"{len(transfers)} transfers; a model holds {_MOST_ITEMS}, combine some"
    capacities = {tank.name: tank.capacity for tank in tanks}
    pairs: set[str] = set()
    for transfer in transfers:
        if transfer.item in pairs:
            yield f"transfer {transfer.item} is there twice; give the pumps as one, rates added"
        pairs.add(transfer.item)
        for problem in _problems_of(transfer, capacities):
            yield f"transfer {transfer.item}: {problem}"


def _problems_of(transfer: Transfer, capacities: Mapping[str, float]) -> Iterator[str]:
    """Yield the problems of one pump between tanks of these capacities. [kg]"""
    for name in (transfer.source, transfer.target):
        if name not in capacities:
            yield f"{name!r} is not a tank; allowed: {', '.join(capacities)}"
    if not {transfer.source, transfer.target} <= capacities.keys():
        return
    if transfer.source == transfer.target:
        yield "source and target are the same tank; give two tanks"
    if not 0.0 < transfer.rate < float("inf"):
        yield f"the rate is {transfer.rate:g} kg/s; give a positive flow, e.g. 0.1 kg/s"
    most = capacities[transfer.source]
    if not 0.0 <= transfer.leave <= most:
        yield (
            f"leave is {transfer.leave:g} kg; give zero to the capacity of the source, {most:g} kg"
        )
    most = capacities[transfer.target]
    if not 0.0 < transfer.fill <= most:
        yield (
            f"fill is {transfer.fill:g} kg; give more than zero and at most the capacity of the "
            f"target, {most:g} kg"
        )
    if not _SHORTEST * transfer.rate <= transfer.band < float("inf"):
        yield (
            f"band is {transfer.band:g} kg; give at least what the pump moves in {_SHORTEST:g} s, "
            f"{_SHORTEST * transfer.rate:g} kg"
        )


def tanks_reached(transfers: Sequence[Transfer], fed: set[str]) -> set[str]:
    """Return the tanks whose fuel comes to an engine: those of a feed, and those pumped to them."""
    reached = set(fed)
    for _ in transfers:
        reached |= {item.source for item in transfers if item.target in reached}
    return reached


_Mass = Annotated[float, InUnits("kg")]


class TransferTable(Strict):
    """A pump of ``[fuel]``."""

    model_config = ConfigDict(protected_namespaces=())

    source: str = Field(examples=["tip"], description="Name of the tank that it empties.")
    target: str = Field(examples=["left"], description="Name of the tank that it fills.")
    rate: Annotated[float, InUnits("kg s-1")] = Field(
        examples=["0.1 kg/s"], description="Flow of the pump."
    )
    leave: _Mass = Field(
        default=0.0, examples=["2 kg"], description="Fuel of the source that it does not reach."
    )
    fill: _Mass | None = Field(
        default=None,
        examples=["190 kg"],
        description="Content of the target at which its float valve is shut; without it the "
        "capacity.",
    )
    band: _Mass | None = Field(
        default=None,
        examples=["0.5 kg"],
        description="Fuel over which the float valve shuts and over which the pump runs dry; "
        "without it what the pump moves in 1 s.",
    )
    on: bool = Field(
        default=False,
        examples=[True],
        description="Whether it pumps where nothing drives its input transfer.SOURCE.TARGET.pump.",
    )


def transfers_of(items: Sequence[TransferTable], tanks: Sequence[Tank]) -> tuple[Transfer, ...]:
    """Return the pumps of a file; `fill` and `band` have their values."""
    capacities = {tank.name: tank.capacity for tank in tanks}
    read = []
    for item in items:
        # an unknown tank is refused by its name later
        fill = capacity = capacities.get(item.target, 0.0)
        # a capacity in another unit may be smaller by its rounding
        if item.fill is not None and abs(item.fill - capacity) > _ROUNDING * capacity:
            fill = item.fill
        band = _BAND_TIME * item.rate if item.band is None else item.band
        read.append(Transfer(**{**dict(item), "fill": fill, "band": band}))
    return tuple(read)
