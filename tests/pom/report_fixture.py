"""Results of Proof-of-Match cases for the report's tests: linear airplanes of our own, judged as
the replay would.
"""

import numpy as np
import pandas as pd
import xarray as xr

from flightmech import terms
from pom.cases.case import PomCase
from pom.diagnosis.tuning.tuning_log import KIND
from pom.result import PomResult, make_verdict_table
from pom.tolerances.bands import RowRemark, reason_remarks
from pom.tolerances.criteria import Band, Criterion, Limit

STANDARD, EDITION = "FAA 14 CFR Part 60 App A Table A2A", "2014-01-01"
DEG = np.pi / 180.0
RUNS = ("datcom", "corrected", "final")


def linear(A, B, u, step, x0=None):
    """Heun steps of x' = A x + B u."""
    x = np.zeros((len(u), len(A)))
    if x0 is not None:
        x[0] = x0
    for k in range(len(u) - 1):
        a = A @ x[k] + B * u[k]
        b = A @ (x[k] + step * a) + B * u[k + 1]
        x[k + 1] = x[k] + step * (a + b) / 2
    return x


def short_period(u, step, lift=1.0, damping=1.0, power=1.0):
    V, La, Lt = 62.0, 1.15 * lift, 9.81 / 62.0
    A = np.array([[-La, 1.0, 0.0], [-5.2, -1.9 * damping, 0.0], [0.0, 1.0, -0.02 * Lt]])
    x = linear(A, np.array([-0.08, -9.5 * power, 0.0]), u, step)
    speed = V - 9.81 * step * np.cumsum(x[:, 2])
    return {
        "alpha": 0.09 + x[:, 0],
        "q": x[:, 1],
        "theta": 0.07 + x[:, 2],
        "nz": 1.0 + V * La * x[:, 0] / 9.81,
        "V": speed,
    }


def roll(u, step, damping=1.0):
    x = linear(np.array([[-2.4 * damping, 0.0], [1.0, 0.0]]), np.array([-7.5, 0.0]), u, step)
    return {"p": x[:, 0], "phi": x[:, 1], "beta": 0.01 * x[:, 0], "V": 85.0 + 0.0 * u}


def signals(time, flight, models):
    runs = ["flight", *models]
    empty = np.full(len(time), np.nan)
    data = {
        c: (("run", "time"), np.stack([flight[c], *(m.get(c, empty) for m in models.values())]))
        for c in flight
    }
    return xr.Dataset(data, {"run": runs, "time": time})


def judge(case, data, runs):
    """Return tolerance and verdict of the trace criteria of a case; all else is taken as given."""
    time = data["time"].values
    tolerance, rows = {}, []
    for c in case.criteria:
        inside = (time >= c.window[0]) & (time <= c.window[1])
        flight = data[c.channel].sel(run="flight").values
        unit = next(x.unit for x in c.band.limits if x.unit != "%")
        factor = {"deg": DEG, "deg/s": DEG, "g": 1.0, "kt": 1852 / 3600}[unit]
        widths = [
            x.value * factor if x.unit != "%" else x.value / 100 * np.abs(flight)
            for x in c.band.limits
        ]
        half = np.where(
            inside, np.max(np.broadcast_arrays(*widths, np.zeros(len(time))), axis=0), np.nan
        )
        tolerance[c.channel] = "time", half
        for run in runs:
            error = data[c.channel].sel(run=run).values - flight
            row = dict(
                run=run, criterion=c.name, channel=c.channel, measure=c.measure, group=c.group,
                window_start=c.window[0],
                window_stop=c.window[1], tolerance_text=c.band.text, width=np.nanmin(half) / factor,
                unit=unit, provenance=c.provenance,
            )  # fmt: skip
            if not np.isfinite(error).all():
                rows.append(
                    {**row, "verdict": "invalid", "remarks": reason_remarks("no finite response")}
                )
                continue
            ratio = np.abs(error) / half
            k = int(np.nanargmax(ratio))
            out = np.flatnonzero(ratio > 1)
            rows.append(
                {
                    **row,
                    "worst": error[k] / factor,
                    "worst_ratio": ratio[k],
                    "at": time[k],
                    "first_exit": time[out[0]] if len(out) else np.nan,
                    "inside": float((ratio[inside] <= 1).mean()),
                    "verdict": "fail" if len(out) else "pass",
                    "remarks": (RowRemark("row", c.note),) if c.note else (),
                }
            )
    return xr.Dataset(tolerance, {"time": time}), make_verdict_table(rows)


def criterion(name, channel, group, window, *limits, provenance="verified", note=""):
    rule = "greater_of" if len(limits) > 1 else "single"
    return Criterion(
        name,
        name,
        channel,
        "trace",
        group,
        Band(limits, rule, "ref_local"),
        window,
        provenance=provenance,
        note=note,
    )


def trim(columns):
    rows = [
        "V",
        "alpha",
        "theta",
        "delta_e",
        "trim.delta_e",
        "trim.thrust",
        "trim.u_dot",
        "trim.w_dot",
        "trim.q_dot",
    ]
    values = {"flight": [62.0, 0.09, 0.07, -0.03, *[np.nan] * 5]}
    for i, run in enumerate(columns):
        values[run] = [
            62.0,
            0.09 + 0.004 * (2 - i),
            0.07,
            -0.03,
            0.011 - 0.005 * i,
            120.0 - 55.0 * i,
            1e-12,
            -3e-11,
            2e-12,
        ]
    return pd.DataFrame(values, index=pd.Index(rows, name="quantity"))


CONDITIONS = {
    "V": 62.0, "mach": 0.19, "h": 3048.0, "temperature": 268.15, "p_static": 69680.0, "wind_n": 4.1,
    "wind_e": -2.2,
    "mass": 2850.0, "x_cg": 0.247, "Iyy": 4500.0, "delta_f": 40 * DEG, "gear": 1.0,
    "speedbrake": 0.0, "alpha": 0.09, "theta": 0.07,
}  # fmt: skip


def short_period_result(
    name="short_period_full_flaps", title="Short period, full flaps, gear down", poor=0.62
):
    step = 0.02
    time = 4.0 + step * np.arange(701)
    u = -3.2 * DEG * np.clip((time - 5.0) / 0.15, 0, 1) + 3.2 * DEG * np.clip(
        (time - 7.0) / 0.15, 0, 1
    )
    rng = np.random.default_rng(7)
    flight = short_period(u, step)
    models = {
        "datcom": short_period(u, step, lift=poor, damping=0.6),
        "corrected": short_period(u, step, lift=0.97, damping=0.9),
        "final": short_period(u, step, lift=1.005, damping=1.01),
    }
    flight = {
        c: v + rng.normal(0, s, len(time))
        for (c, v), s in zip(flight.items(), [4e-4, 6e-4, 2e-4, 4e-3, 0.05], strict=True)
    }
    window = (4.5, 18.0)
    criteria = (
        criterion("pitch_angle", "theta", "pitch", window, Limit("absolute", 1.5, "deg")),
        criterion("pitch_rate", "q", "pitch", window, Limit("absolute", 2.0, "deg/s")),
        criterion(
            "normal_acceleration",
            "nz",
            "g3",
            window,
            Limit("absolute", 0.1, "g"),
            provenance="memory",
        ),
    )
    case = PomCase(
        name, title, "2.c.10", STANDARD, EDITION, "cases/short_period.toml",
        "flight/t37_21_short_period.nc", (4.0, 18.0),
        description="Elevator back for two seconds, then released; the airplane answers with its "
            "short period.",
        events={"input_end": 7.15}, criteria=criteria,
    )  # fmt: skip
    data = signals(time, flight, models)
    tolerance, verdict = judge(case, data, RUNS)
    applied = {
        "delta_e": u - 1.7 * DEG,
        "delta_a": 0 * u,
        "delta_f": 0 * u + 40 * DEG,
        "engine1.thrust_drive": 5200 + 15 * np.sin(time),
    }
    inputs = xr.Dataset(
        {name: ("time", values) for name, values in applied.items()}, {"time": time}
    )
    return PomResult(case, CONDITIONS, data, tolerance, inputs, trim(RUNS), verdict)


def roll_result():
    step = 0.02
    time = 30.0 + step * np.arange(501)
    u = -6.0 * DEG * (np.clip((time - 31.0) / 0.2, 0, 1) - np.clip((time - 36.0) / 0.2, 0, 1))
    flight = roll(u, step)
    models = {
        "datcom": roll(u, step, 0.86),
        "corrected": roll(u, step, 0.97),
        "final": roll(u, step, 1.003),
    }
    window = (30.5, 40.0)
    case = PomCase(
        "roll_response_clean", "Roll response, clean", "2.d.2", STANDARD, EDITION,
        "cases/roll.toml", "flight/t37_31_roll.nc", (30.0, 40.0),
        description="Aileron held for five seconds.",
        criteria=(criterion("roll_rate", "p", "g1", window, Limit("percent", 10.0, "%"),
            Limit("absolute", 2.0, "deg/s")),),
    )  # fmt: skip
    data = signals(time, flight, models)
    tolerance, verdict = judge(case, data, RUNS)
    inputs = xr.Dataset(
        {"delta_a": ("time", u), "delta_r": ("time", 0.2 * u), "delta_f": ("time", 0 * u)},
        {"time": time},
    )
    return PomResult(
        case,
        {**CONDITIONS, "delta_f": 0.0, "gear": 0.0, "V": 85.0},
        data,
        tolerance,
        inputs,
        trim(RUNS),
        verdict,
    )


def crashed_result():
    """A case in which one model stopped: its signals are missing and its rows invalid."""
    good = short_period_result("approach_elevator_step", "Elevator step in approach")
    data = good.signals.copy(deep=True)
    for channel in data.data_vars:
        data[channel].loc[{"run": "corrected"}] = np.nan
    tolerance, verdict = judge(good.case, data, RUNS)
    text = "corrected: the FMU stopped at 6.42 s: fmi2DoStep returned error"
    return PomResult(
        good.case, good.conditions, data, tolerance, good.inputs, good.trim, verdict, failure=text
    )


def tuning(results, run="final"):
    """Return a log of `aeromatch pom tune` that states of `run` what the results show."""
    rows = []
    for result in results:
        worst = result.worst(run)
        after = {
            "after": result.status(run),
            "ratio_after": worst["worst_ratio"],
            "criterion_after": worst["criterion"],
        }
        before = {"before": "fail", "ratio_before": 1.7, "criterion_before": worst["criterion"]}
        rows.append(
            {
                "case": result.case.name,
                "id": result.case.id,
                "title": result.case.title,
                "wanted": True,
                **before,
                **after,
            }
        )
    far = {
        "moved": 1.31,
        "from_evidence": 1.24,
        "share": 0.93,
        "nodes": 12,
        "at": "mach 0.2, alpha 4 deg",
    }
    near = {"moved": 0.02, "from_evidence": 0.02, "share": 0.004, "nodes": 1, "at": ""}
    moves = [
        {"term": "Cm/elevator", "rationale": "horn <worn>", **far},
        {"term": "Cm/qhat", "rationale": "", **near},
    ]
    files = {"database": {"name": "old.nc", "sha256": "ab" * 32}}
    return {
        "kind": KIND,
        "refusal": "",
        "bound": 2.0,
        "distance": 1.4,
        "model": "cd" * 32,
        "files": files,
        "moves": moves,
        "rows": rows,
    }


def results():
    return [short_period_result(), roll_result(), crashed_result()]


def databases():
    """A prior and a final database: one table family replaced, one scalar, one added, one
    dropped.
    """
    alpha, mach, flap = (
        np.radians(np.arange(-4.0, 17.0, 2.0)),
        np.array([0.1, 0.3, 0.5]),
        np.radians([0.0, 20.0, 40.0]),
    )
    lift = (
        0.12
        + 4.9 * alpha[:, None] / np.sqrt(1 - mach**2)
        - 6.0 * np.clip(alpha[:, None] - 0.2, 0, None) ** 2
    )
    lift_true = (
        0.15
        + 4.6 * alpha[:, None] / np.sqrt(1 - mach**2)
        - 20.0 * np.clip(alpha[:, None] - 0.15, 0, None) ** 2
    )
    flown = (alpha[:, None] > -0.02) & (alpha[:, None] < 0.2) & (mach > 0)
    final_basic = terms.make_term(
        lift_true,
        {"alpha": alpha, "mach": mach},
        stderr=np.where(flown, 0.006, 0.05),
        source="flight",
    )
    final_basic["source"].values[~flown] = 0
    axes = {"alpha": alpha, "delta_f": flap}
    flaps = np.outer(np.ones(len(alpha)), [0.0, 0.28, 0.45]) - 0.3 * np.outer(alpha, [0, 0.5, 1.0])
    prior = {
        "CL": {
            "basic": terms.make_term(
                lift, {"alpha": alpha, "mach": mach}, source="datcom", stderr=0.08
            ),
            "flap": terms.make_term(flaps, axes, source="datcom"),
            "qhat": terms.make_term(5.1, regressors=["qhat"], source="datcom", stderr=1.2),
            "tab": terms.make_term(0.12, regressors=["delta_t"], source="datcom"),
        },
        "CD": {
            "basic": terms.make_term(
                0.021 + 0.06 * lift**2, {"alpha": alpha, "mach": mach}, source="datcom"
            )
        },
        "Cm": {
            "basic": terms.make_term(
                0.03 - 0.9 * alpha[:, None] * np.ones(3),
                {"alpha": alpha, "mach": mach},
                source="datcom",
            ),
            "elevator": terms.make_term(
                -1.1 - 0.3 * alpha, {"alpha": alpha}, ["delta_e"], source="datcom", stderr=0.2
            ),
        },
    }
    final = {c: dict(leaves) for c, leaves in prior.items()}
    final["CL"]["basic"] = final_basic
    final["CL"]["qhat"] = terms.make_term(
        8.3,
        regressors=["qhat"],
        source="flight",
        stderr=0.4,
        comment="holds the effect of alpha-dot",
    )
    final["CL"]["gear"] = terms.make_term(
        -0.012 - 0.05 * alpha, {"alpha": alpha}, ["gear"], source="flight", stderr=0.004
    )
    final["Cm"]["elevator"] = terms.make_term(
        -1.32 - 0.35 * alpha, {"alpha": alpha}, ["delta_e"], source="flight", stderr=0.03
    )
    del final["CL"]["tab"]
    return {
        "datcom": tree(prior, "DATCOM", absent="CL/gear Cn/rudder"),
        "final": tree(final, "DATCOM and flight"),
    }


def tree(leaves, source, absent=""):
    leaf = {f"/{c}/{name}": ds for c, group in leaves.items() for name, ds in group.items()}
    root = xr.Dataset(
        attrs={
            "title": source,
            "aircraft": "T-37",
            "source": source,
            "absent": absent,
            "force_axes": "stability",
        }
    )
    return xr.DataTree.from_dict({"/": root, **leaf})


PROVENANCE = {
    "date": "2026-11-20",
    "command": "aeromatch pom run cases/ --model datcom=datcom.fmu --model "
        "corrected=corrected.fmu --model final=final.fmu",
    "versions": {"aeromatch": "0.1.0", "fmpy": "0.3.32", "numpy": "2.4.6"},
    "inputs": {
        "flight/t37_21_short_period.nc": "9f2c" + "0" * 56 + "a1b2",
        "flight/t37_31_roll.nc": "77aa" + "1" * 56 + "c0de",
        "t37.toml": "beef" + "2" * 60,
    },
    "models": {run: {"file": f"{run}.fmu", "sha256": f"{i}{i}ab" + "3" * 60} for i,
        run in enumerate(RUNS)},
}  # fmt: skip


def diagnosis():
    """A term-swap table with the columns of `pom.diagnose`; mismatches and shares are of one
    arithmetic.
    """
    nan = np.nan
    flown = [
        ("prior", "", nan, "fail", 1.21, 2.22, 0.9, 1.63),
        ("final", "", nan, "pass", 0.02, 0.04, 0.03, 0.05),
        ("single", "CL/gear", nan, "pass", 0.25, 0.61, 0.22, 0.42),
        ("single", "Cm/qhat", nan, "fail", 1.1, 2.0, 0.84, 1.48),
        ("single", "CL/basic", nan, "fail", 1.2, 2.21, 0.9, 1.62),
        ("group", "CL/*", nan, "pass", 0.24, 0.6, 0.22, 0.42),
        ("pair", "CL/gear + Cm/qhat", 0.12, "pass", 0.02, 0.04, 0.03, 0.06),
        ("sequence", "CL/gear", nan, "pass", 0.25, 0.61, 0.22, 0.42),
        ("share", "CL/basic", nan, "not_tested", 1.23, nan, 0.91, nan),
        ("share", "Cm/qhat", nan, "not_tested", 1.06, nan, 0.8, nan),
        ("share", "CL/gear", nan, "not_tested", 0.02, nan, 0.03, nan),
    ]
    found = []
    before = (1.21, 0.9)
    for stage, term, interaction, verdict, *numbers in flown:
        left = numbers[::2]
        explained = [
            (a - x) / (m - e)
            for a, x, m, e in zip(
                before if stage == "share" else (1.21, 0.9), left, (1.21, 0.9), (0.02, 0.03)
            )
        ]
        before = left if stage == "share" else before
        stderr = 0.03 if stage == "share" else nan
        row = {
            "stage": stage,
            "term": term,
            "explained": explained[0],
            "stderr": stderr,
            "interaction": interaction,
            "verdict": verdict,
        }
        for k, name in enumerate(("pitch_angle", "pitch_rate")):
            row |= {
                f"{name} mismatch": left[k],
                f"{name} ratio": numbers[2 * k + 1],
                f"{name} explained": explained[k],
                f"{name} stderr": stderr,
            }
        found.append({**row, "mismatch": left[0]})
    return pd.DataFrame(found)


def column_sweep_result():
    """Force over position of a slow sweep, with friction; one model with too much of it."""
    time = 0.02 * np.arange(1001)
    column = 0.15 * np.interp(time, [1.0, 6.0, 14.0, 19.0], [0.0, 1.0, -1.0, 0.0])
    way = np.sign(np.gradient(column))
    force = {
        run: 600.0 * column + friction * way
        for run, friction in zip(("flight", *RUNS), (10.0, 45.0, 12.0, 10.5), strict=True)
    }
    band = Band(
        (Limit("absolute", 5.0, "lbf"), Limit("percent", 10.0, "%")), "greater_of", "ref_local"
    )
    row = Criterion(
        "column_force",
        "column_force",
        "F_column",
        "curve",
        "g1",
        band,
        (1.0, 19.0),
        abscissa="column",
    )
    case = PomCase(
        "column_sweep", "Column force against position", "2.a.1.a", STANDARD, EDITION,
        "cases/sweep.toml", "flight/t37_40_sweep.nc",
        (0.0, 20.0), description="Column slowly full aft, full forward, neutral.", criteria=(row,),
    )  # fmt: skip
    data = xr.Dataset(
        {
            "column": (("run", "time"), np.stack([column] * 4)),
            "F_column": (("run", "time"), np.stack(list(force.values()))),
        },
        {"run": ["flight", *RUNS], "time": time},
    )
    same = {
        "criterion": row.name,
        "channel": row.channel,
        "measure": row.measure,
        "group": row.group,
        "unit": "lbf",
        "provenance": "verified",
    }
    same |= {
        "window_start": 1.0,
        "window_stop": 19.0,
        "tolerance_text": band.text,
        "fraction": 1.0,
        "width": 5.0,
        "at": 3.0,
    }
    worst = {"datcom": 7.87, "corrected": 0.45, "final": 0.11}
    rows = [
        {
            **same,
            "run": run,
            "worst": w,
            "worst_ratio": w / 5.0,
            "verdict": "pass" if w <= 5.0 else "fail",
        }
        for run, w in worst.items()
    ]
    inputs = xr.Dataset({"column": ("time", column)}, {"time": time})
    return PomResult(
        case,
        CONDITIONS,
        data,
        xr.Dataset(coords={"time": time}),
        inputs,
        trim(RUNS),
        make_verdict_table(rows),
    )


def fits():
    """Two local models of lift from two manoeuvres, one of them without the terms it needs."""
    import flighttest

    rng = np.random.default_rng(3)
    t = 0.02 * np.arange(300)
    parts = []
    for mach in (0.2, 0.25):
        alpha = np.radians(4.0 + 2.0 * np.sin(0.9 * t))
        qhat, elevator = (
            0.002 * np.cos(0.9 * t) + rng.normal(0.0, 1e-4, t.size),
            np.radians(2.0 * np.sign(np.sin(2.0 * t))),
        )
        lift = 0.3 + 4.9 * alpha + 6.0 * qhat + 0.4 * elevator + rng.normal(0.0, 0.004, t.size)
        data = {
            "CL": lift,
            "alpha": alpha,
            "qhat": qhat,
            "delta_e": elevator,
            "mach": 0.0 * t + mach,
        }
        parts.append(
            xr.Dataset({name: ("time", values) for name, values in data.items()}, {"time": t})
        )
    words = (["1", "alpha", "qhat", "delta_e"], ["1", "alpha"])
    return [
        flighttest.regress(
            flighttest.RegressionModel("CL", terms), parts, name=f"short period, {len(terms)} terms"
        )
        for terms in words
    ]
