"""Ten deceptions by tables of names, control of a foreign model, copies and reports.

    aeromatch match data/c182/aeromatch.toml -o out/c182
    python benchmarks/names_and_copies.py out/c182

None of them is in the other scripts of deceptions: factors on inputs and parameters of one model, a
foreign model that is held only near the flown trajectory, a recording made of the flight and noise,
a mass and a lift that are wrong together, one rationale for two cases.
Printed: a line each, with the line of the report that names it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from deceptions import RUN, Deception, judge
from scipy.ndimage import gaussian_filter1d
from ten_deceptions import stated
from thirty_deceptions import TIME, LightBench, one_case, run_deceptions

import aerodb
from pom.cases.case import read_case
from pom.replaying.batch import replay_all
from pom.replaying.recorded_runs import RecordedRun, RecordedRuns
from pom.replaying.replay_case import plan_of

Judged = tuple[list[str], str]


def with_names(b: LightBench, case: str, lines: str, **factors: float) -> Judged:
    """Judge a case with a table of names of the model, whose terms are scaled."""
    names = b.file("_model.toml")
    names.write_text(lines, encoding="utf-8")
    more = f'[models]\n{RUN} = "{names}"'
    return one_case(b, case, more=more, model=b.spoilt(**factors))


def elevator_of_the_names(b: LightBench) -> Judged:
    """A model with a weak elevator gets more of it than the record has."""
    lines = '[inputs]\ndelta_e = { variable = "delta_e", scale = 1.25 }\n'
    return with_names(b, "short_period", lines, Cm__elevator=0.8)


def mass_of_the_names(b: LightBench) -> Judged:
    """A model with too little lift is flown with less mass."""
    lines = '[parameters]\n"mass.mass" = { variable = "mass.mass", scale = 0.85 }\n'
    return with_names(b, "short_period", lines, CL__basic=0.85)


def held_near_the_flight(b: LightBench, width: float = 0.05) -> Judged:
    """A foreign model is guided by the record while it is near the flown trajectory.

    `width` is that of the neighbourhood, in ranges of a channel.
    """

    def answer(honest, own, flight):
        out = dict(own)
        for name, values in own.items():
            if name not in flight or name not in honest:
                continue
            size = max(float(np.ptp(honest[name])), 1e-9)
            near = np.exp(-((((values - honest[name]) / size) / width) ** 2))
            out[name] = values + near * gaussian_filter1d(flight[name] - honest[name], 12.0)
        return out

    return judge(Deception([b.case("short_period")], b.spoilt(Cm__qhat=0.4), answer=answer))


def held_far_from_the_flight(b: LightBench) -> Judged:
    """The same with a wide neighbourhood: the guidance fades as slowly as the inputs change."""
    return held_near_the_flight(b, 0.5)


def recording_of_flight_and_noise(b: LightBench, share: float = 1.0) -> Judged:
    """The flight record with noise of its own size, as the recording of a device."""
    case = read_case(b.case("short_period"))
    (flown,) = replay_all([case], {RUN: b.final}, jobs=1)
    time = flown.signals["time"].values
    channels = {}
    for name in map(str, flown.signals.data_vars):
        values = flown.signals[name].sel(run="flight").values
        noise = share * np.nanstd(np.diff(values)) / np.sqrt(2.0)
        channels[name] = (time, values + b.rng.normal(0.0, 1.0, time.size) * noise)
    states = plan_of(case).states
    for name in ("delta_e", "delta_a", "delta_r"):
        channels[name] = (states["time"].values, states[name].values)
    line = RecordedRun(channels, "device.csv, recording, sha256 0", "recording of a device")
    recorded = {case.name: RecordedRuns({RUN: line})}
    return stated(replay_all([case], {}, recorded=recorded, jobs=1))


def noisier_recording(b: LightBench) -> Judged:
    """The same with three times the noise, in which that of the record is lost."""
    return recording_of_flight_and_noise(b, 3.0)


def mass_and_lift(b: LightBench) -> Judged:
    """Mass, lift and drag are wrong by the same 12 percent, so that no force shows it."""
    columns = b.columns("check_short_period")
    found = [name for name in columns if "mass" in name.lower()]
    for name in found:
        columns[name] = 1.12 * columns[name]
    model = b.spoilt(CL__basic=1.12, CD__basic=1.12)
    evidence = aerodb.open(b.demo / "final.nc")
    record = b.written(columns)
    return one_case(b, "short_period", record=record, model=model, evidence=evidence)


def stretched_clock(b: LightBench) -> Judged:
    """The clock of the record runs 8 percent slow, as the wrong stiffness of the model needs."""
    columns = b.columns("check_short_period")
    clock = columns[TIME]
    columns[TIME] = clock[0] + 1.08 * (clock - clock[0])
    model = b.spoilt(Cm__basic=0.86, Cm__qhat=0.92)
    return one_case(b, "short_period", record=b.written(columns), model=model)


def one_rationale_for_two(b: LightBench) -> Judged:
    """A bias of the elevator is allowed by the rationale of another case."""
    more = '[rationale]\n"trim.delta_e" = "J. Smith, 2024-05-17, stick creep of flight 12 at 90 kt"'
    cases = []
    for case, record in (("short_period", "check_short_period"), ("phugoid", "check_phugoid")):
        columns = b.columns(record)
        columns["Elevator (deg)"] = columns["Elevator (deg)"] + 1.6
        cases.append(b.case(case, more=more, record=b.written(columns)))
    return judge(Deception(cases, b.final))


def inertia_of_the_model(b: LightBench) -> Judged:
    """Inertia and moments of the model are wrong together."""
    model = b.spoilt(
        lambda craft: replace(craft, Iyy=1.3 * craft.Iyy),
        Cm__basic=1.3,
        Cm__qhat=1.3,
        Cm__elevator=1.3,
    )
    evidence = aerodb.open(b.demo / "final.nc")
    return one_case(b, "short_period", model=model, evidence=evidence)


DECEPTIONS = (
    (elevator_of_the_names, "leave the scale out"),
    (mass_of_the_names, "leave the scale out"),
    (held_near_the_flight, "depends on time"),
    (held_far_from_the_flight, "depends on time"),
    (recording_of_flight_and_noise, "noise of the record"),
    (noisier_recording, "noise of the record"),
    (mass_and_lift, "standard errors from what flight found"),
    (stretched_clock, "the flight fits best with inputs of"),
    (one_rationale_for_two, "is beyond 1 deg .*allowed: J. Smith"),
    (inertia_of_the_model, "Iyy is"),
)


if __name__ == "__main__":
    run_deceptions(__doc__, [(make.__name__, make, word) for make, word in DECEPTIONS])
