"""Geometry and inertia of aircraft files: public aeroplanes pass, chord and span exchanged and
wrong units do not.
"""

from dataclasses import dataclass

import pytest

from flighttest.reconstruction.quality.declarations.geometry import geometry_findings
from flighttest.reconstruction.quality.declarations.inertia import inertia_findings

FOOT = 0.3048


@dataclass
class Shape:
    S: float
    cbar: float
    b: float
    mass: float
    Ixx: float = 1.0
    Iyy: float = 1.0
    Izz: float = 1.0
    Ixy: float = 0.0
    Ixz: float = 0.0
    Iyz: float = 0.0


# public figures: S m2, cbar m, b m, mass kg
AEROPLANES = {
    "Cessna 182": (16.17, 1.494, 10.91, 1034.0),
    "T-37": (16.91, 1.667, 10.31, 2150.0),
    "Citation II": (30.0, 2.057, 15.91, 6000.0),
    "F-16": (27.87, 3.45, 9.144, 9300.0),
    "F-104": (18.22, 2.91, 6.69, 9000.0),
    "Space Shuttle": (249.9, 12.06, 23.8, 90000.0),
    "Boeing 747": (511.0, 8.32, 59.64, 300000.0),
    "DHC-6": (39.0, 1.98, 19.8, 5000.0),
    "B-2": (478.0, 12.07, 52.4, 100000.0),
    "small UAV": (0.384, 0.24, 1.6, 3.3),
}


@pytest.mark.parametrize("name", AEROPLANES)
def test_geometry_of_aeroplanes(name):
    S, cbar, b, mass = AEROPLANES[name]
    assert geometry_findings(Shape(S, cbar, b, mass)) == []
    mistakes = {
        ("cbar", "b"): Shape(S, b, cbar, mass),
        ("S",): Shape(S / FOOT**2, cbar, b, mass),
        ("b",): Shape(S, cbar, b / FOOT, mass),
        ("cbar",): Shape(S, cbar / FOOT, b, mass),
    }
    for names, shape in mistakes.items():
        (finding,) = geometry_findings(shape)
        assert finding.channels == names
        slender = b**2 / S < 2.5  # a lifting body looks like it with both exchanged
        assert finding.severity == ("warning" if slender and names == ("cbar", "b") else "error")


@pytest.mark.parametrize(
    "shape",
    [Shape(26.6, 8.61, 4.23, 8700.0), Shape(358.0, 27.66, 25.6, 140000.0)],
    ids=["HL-20", "Concorde"],
)
def test_odd_but_real_shapes_are_no_error(shape):
    assert [finding.severity for finding in geometry_findings(shape)] == ["warning"]


# Zeppelin NT, 75 m long, 14.1 m across, 8225 m3; SS class, 43.7 m, 9.1 m, 1700 m3
AIRSHIPS = {
    "two thirds of the volume, one length": (407.0, 75.0, 75.0, 8040.0),
    "two thirds of the volume, its cube root": (407.0, 20.2, 20.2, 8040.0),
    "two thirds of the volume, length and diameter": (407.0, 75.0, 14.1, 8040.0),
    "length taken as the span": (407.0, 14.1, 75.0, 8040.0),
    "plan": (1000.0, 75.0, 14.1, 8040.0),
    "cross-section": (65.0, 43.7, 9.1, 1433.0),
    "cross-section, one length": (65.0, 43.7, 43.7, 1433.0),
}


@pytest.mark.parametrize("name", AIRSHIPS)
def test_airships_are_not_judged_as_wings(name):
    S, cbar, b, mass = AIRSHIPS[name]
    (finding,) = geometry_findings(Shape(S, cbar, b, mass))
    assert (finding.severity, finding.name) == ("note", "geometry:S+cbar+b")
    heavy = geometry_findings(Shape(S, cbar, b, 20.0 * mass))  # an aeroplane of the same figures
    assert [one.severity for one in heavy] != ["note"]


def test_radii_of_gyration_of_an_airship_are_over_its_length():
    hull = Shape(407.0, 75.0, 14.1, 8040.0, 200e3, 2.4e6, 2.4e6)
    assert inertia_findings(hull) == []


def test_span_typed_twice_is_no_airship():
    for S, _, b, mass in AEROPLANES.values():
        assert not any(one.severity == "note" for one in geometry_findings(Shape(S, b, b, mass)))


# mass, span, Ixx, Iyy, Izz, Ixz: public figures
INERTIAS = {
    "Cessna 182": (1034.0, 10.91, 2827.0, 1913.0, 4169.0, -39.0),
    "T-37": (2150.0, 10.31, 10826.0, 8135.0, 15162.0, 0.0),
    "Citation II": (6000.0, 15.91, 28860.0, 35348.0, 63796.0, 3038.0),
    "F-16": (9300.0, 9.144, 12875.0, 75674.0, 85552.0, 1331.0),
    "F-104": (7480.0, 6.69, 4745.0, 78630.0, 81340.0, 0.0),
    "Boeing 747": (288800.0, 59.64, 24.68e6, 44.88e6, 67.38e6, 1.32e6),
}


@pytest.mark.parametrize("name", INERTIAS)
def test_inertia_of_aeroplanes(name):
    mass, b, *moments, Ixz = INERTIAS[name]
    assert inertia_findings(Shape(1.0, 1.0, b, mass, *moments, Ixz=Ixz)) == []
    Ixx, Iyy, Izz = moments
    (finding,) = inertia_findings(Shape(1.0, 1.0, b, mass, Ixx, Iyy, 1.3 * (Ixx + Iyy)))
    assert (finding.severity, finding.kind, finding.channels[0]) == ("error", "inertia", "Izz")
    found = inertia_findings(
        Shape(1.0, 1.0, b, mass, 23.73 * Ixx, 23.73 * Iyy, 23.73 * Izz)
    )  # lb ft2 taken as kg m2
    assert found
    found = inertia_findings(Shape(1.0, 1.0, b, mass, Izz, Iyy, Ixx))
    assert "Izz" in found[-1].text


def test_one_moment_in_another_unit():
    """Iyy of the C182 in kg m2 under lb ft2."""
    found = inertia_findings(Shape(16.17, 1.494, 10.91, 1034.0, 2827.0, 1913.0 / 23.73, 4169.0))
    assert {name for finding in found for name in finding.channels} == {"Iyy"}
    assert "Iyy were in kg m2 and taken as lb ft2" in found[-1].text


def test_a_moment_a_little_above_the_sum_of_the_others():
    def severity(Izz):
        (finding,) = inertia_findings(Shape(16.17, 1.494, 10.91, 1034.0, 2827.0, 1913.0, Izz))
        return finding.severity

    # 2, 9 and 15 % above
    assert [severity(Izz) for Izz in (4835.0, 5169.0, 5450.0)] == ["note", "warning", "error"]
