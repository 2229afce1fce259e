"""The database of the whole build-up: evaluated along a record against SciPy and xarray, opened,
edited, saved and exported.

Peers work on the same tables in the same run, and their results must be equal: python
benchmarks/database.py
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import xarray as xr
from scipy.interpolate import RegularGridInterpolator
from timing import best  # next to this file

import aerodb
from flightmech import terms
from flightmech.aircraft.aircraft import Aircraft

POINTS = {
    "alpha": np.radians(np.linspace(-8.0, 24.0, 17)),
    "beta": np.radians(np.linspace(-15.0, 15.0, 7)),
    "mach": np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6]),
    "h": np.array([0.0, 3000.0, 6000.0, 9000.0]),
    "h_agl": np.array([0.0, 1.0, 2.0, 4.0, 8.0, 20.0, 30_000.0]),
    "delta_f": np.radians([0.0, 15.0, 30.0, 40.0]),
    "x_cg": np.array([0.15, 0.25, 0.35]),
    "gear": np.array([0.0, 1.0]),
    "speedbrake": np.array([0.0, 1.0]),
}
CONTROL = np.radians(np.linspace(-25.0, 25.0, 7))
SAMPLES = 100_000


def points(axis: str) -> np.ndarray:
    return POINTS.get(axis, CONTROL)


def build_up() -> xr.DataTree:
    """Every term of the scheme for the six coefficients, with all its axes and its factor, and
    random nodes.
    """
    rng = np.random.default_rng(0)
    leaves = {}
    for name, slot in aerodb.store.templates.lr743().items():
        if name.startswith("Ch_"):
            continue
        axes = {axis: points(axis) for axis in slot.axes}
        factor = {slot.K1: (points(slot.K1), rng.random(len(points(slot.K1))))} if slot.K1 else None
        value = rng.normal(size=[len(p) for p in axes.values()])
        leaves[name] = aerodb.store.templates.make(
            name, axes, value=value, K1=factor, stderr=0.1, source="datcom", history="benchmark"
        )
    sizes = {"S": 30.0, "cbar": 2.0, "b": 15.9, "x_ref": 0.0, "y_ref": 0.0, "z_ref": 0.0}
    return aerodb.make_database(
        leaves, title="build-up", aircraft="any", **sizes, force_axes="stability"
    )


def record(db: xr.DataTree, along: bool) -> dict[str, np.ndarray]:
    """All variables of the terms, along a smooth flight or at random."""
    rng = np.random.default_rng(1)
    t = np.linspace(0.0, 1000.0, SAMPLES)
    names = sorted(
        {name for leaf in aerodb.terms(db).values() for name in terms.list_model_variables(leaf)}
    )
    found = {}
    for number, name in enumerate(names):
        low, high = points(name)[[0, -1]]
        part = (
            0.5 + 0.5 * np.sin(0.05 * (number + 1) * t + number) if along else rng.random(SAMPLES)
        )
        found[name] = low + (high - low) * part
    return found


def with_scipy(db: xr.DataTree, x: Mapping[str, np.ndarray]) -> Callable[[], dict[str, np.ndarray]]:
    """The same model from RegularGridInterpolator; tables and points are made ready before the
    clock runs.
    """
    leaves = aerodb.terms(db)
    tables = {}
    for name, leaf in leaves.items():
        for key in ("value", "K1"):
            if key in leaf and leaf[key].ndim:
                tables[name, key] = RegularGridInterpolator(
                    [leaf[axis].values for axis in leaf[key].dims], leaf[key].values
                )
    stacked = {
        axes: np.stack([x[axis] for axis in axes], axis=1)
        for axes in {leaves[n][k].dims for n, k in tables}
    }

    def work() -> dict[str, np.ndarray]:
        sums = {c: np.zeros(SAMPLES) for c in ("CL", "CD", "CY", "Cl", "Cm", "Cn")}
        for name, leaf in leaves.items():
            part = np.ones(SAMPLES)
            for key in ("value", "K1"):
                if key in leaf:
                    part *= (
                        tables[name, key](stacked[leaf[key].dims])
                        if (name, key) in tables
                        else leaf[key].values
                    )
            for word in terms.list_regressors(leaf):
                part *= x[word]
            sums[name.partition("/")[0]] += part
        return sums

    return work


def with_xarray(db: xr.DataTree, x: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The same model from DataArray.interp."""
    along = {name: xr.DataArray(values, dims="time") for name, values in x.items()}
    sums = {c: np.zeros(SAMPLES) for c in ("CL", "CD", "CY", "Cl", "Cm", "Cn")}
    for name, leaf in aerodb.terms(db).items():
        part = np.ones(SAMPLES)
        for key in ("value", "K1"):
            if key in leaf:
                part *= (
                    leaf[key]
                    .interp({axis: along[axis] for axis in leaf[key].dims}, assume_sorted=True)
                    .values
                )
        for word in terms.list_regressors(leaf):
            part *= x[word]
        sums[name.partition("/")[0]] += part
    return sums


def evaluation() -> None:
    db = build_up()
    leaves = aerodb.terms(db)
    tables = sum(
        leaf[key].ndim > 0 for leaf in leaves.values() for key in ("value", "K1") if key in leaf
    )
    print(f"six coefficients of {len(leaves)} terms, {tables} tables, {SAMPLES} samples")
    for word, along in (("along a flight", True), ("random", False)):
        x = record(db, along)
        scipy_work = with_scipy(db, x)

        def ours(x: Mapping[str, np.ndarray] = x) -> dict[str, np.ndarray]:
            return {c: aerodb.evaluate(db, c, **x) for c in ("CL", "CD", "CY", "Cl", "Cm", "Cn")}

        found, peers = ours(), (scipy_work(), with_xarray(db, x))
        differences = [max(np.abs(found[c] - peer[c]).max() for c in found) for peer in peers]
        assert max(differences) < 1e-10, differences
        own, scipy_time, xarray_time = (
            best(ours),
            best(scipy_work, 3),
            best(lambda x=x: with_xarray(db, x), 2),
        )
        print(
            f"  {word:15s} ours {1e3 * own:6.0f} ms   SciPy {1e3 * scipy_time:6.0f} ms, "
            f"ratio {scipy_time / own:.1f}   "
            f"xarray {1e3 * xarray_time:6.0f} ms, ratio {xarray_time / own:.1f}   largest "
            f"difference {max(differences):.0e}"
        )


def of_120_tables() -> xr.DataTree:
    rng = np.random.default_rng(2)
    axes = {
        "mach": POINTS["mach"],
        "alpha": np.radians(np.linspace(-8.0, 24.0, 20)),
        "delta_f": np.radians(np.linspace(0.0, 40.0, 5)),
    }
    leaves = {
        f"{c}/t{i:02d}": terms.make_term(
            rng.normal(size=(6, 20, 5)),
            axes,
            stderr=0.1,
            source="datcom",
            references="bench",
            history="bench",
        )
        for i in range(20)
        for c in ("CL", "CD", "CY", "Cl", "Cm", "Cn")
    }
    sizes = {"S": 30.0, "cbar": 2.0, "b": 15.9, "x_ref": 0.0, "y_ref": 0.0, "z_ref": 0.0}
    return aerodb.make_database(
        leaves,
        title="120 tables",
        aircraft="bench",
        **sizes,
        force_axes="stability",
        source="bench",
    )


def work_on_a_file(folder: Path) -> None:
    db, path, peer = of_120_tables(), folder / "db.nc", folder / "peer.nc"
    leaf = aerodb.terms(db)["CL/t00"]
    aerodb.save(db, path)

    def opened_by_xarray() -> xr.DataTree:
        with xr.open_datatree(path, engine="h5netcdf") as tree:
            return tree.load()

    assert aerodb.open(path).identical(opened_by_xarray())
    rows = {
        "save": (lambda: aerodb.save(db, path), lambda: db.to_netcdf(peer, engine="h5netcdf")),
        "open": (lambda: aerodb.open(path), opened_by_xarray),
        "check": (lambda: aerodb.check(db), None),
        "replace one term": (lambda: aerodb.replace_terms(db, {"CL/t00": leaf}), None),
        "scale one term": (lambda: aerodb.edit.scale(db, "CL/t00", 1.1), None),
        "scale all terms": (lambda: aerodb.edit.scale(db, list(aerodb.terms(db)), 1.1), None),
    }
    print(
        f"120 tables of 6 x 20 x 5 nodes, with standard errors and sources: "
        f"{path.stat().st_size / 1e6:.2f} MB"
    )
    for what, (ours, theirs) in rows.items():
        own = best(ours, 3)
        compared = ""
        if theirs is not None:
            time_of_peer = best(theirs, 2)
            compared = f"   xarray {1e3 * time_of_peer:6.0f} ms, ratio {time_of_peer / own:.1f}"
        print(f"  {what:18s} {1e3 * own:6.0f} ms{compared}")


def exports(folder: Path) -> None:
    db = of_120_tables()
    craft = Aircraft(
        "bench", 30.0, 2.0, 15.9, 5000.0, 15000.0, 22000.0, 34000.0, limits={"delta_f": (0.0, 0.7)}
    )
    rows: dict[str, tuple[Callable, Callable | None]] = {
        "db.mat": (aerodb.exchange.export_matlab, aerodb.exchange.import_matlab),
        "csv": (aerodb.exchange.export_csv, aerodb.exchange.import_csv),
        "cases.csv": (
            aerodb.exchange.export_checkcases,
            lambda path: aerodb.exchange.run_checkcases(db, path),
        ),
        "db.dml": (aerodb.exchange.export_daveml, aerodb.exchange.import_daveml),
        "db.xml": (
            lambda tree, path: aerodb.exchange.export_jsbsim(tree, path, craft),
            aerodb.exchange.import_jsbsim,
        ),
    }
    print("the same, exported and imported (check cases: 200, made and run)")
    for name, (write, read) in rows.items():
        path = folder / name
        there = best(lambda write=write, path=path: write(db, path), 2)
        back = best(lambda read=read, path=path: read(path), 2)
        size = sum(file.stat().st_size for file in (path.iterdir() if path.is_dir() else [path]))
        print(
            f"  {name:18s} {1e3 * there:6.0f} ms out   {1e3 * back:6.0f} ms in   "
            f"{size / 1e6:.2f} MB"
        )


def main() -> None:
    evaluation()
    folder = Path(tempfile.mkdtemp())
    try:
        work_on_a_file(folder)
        exports(folder)
    finally:
        shutil.rmtree(folder)


if __name__ == "__main__":
    main()
