"""Verbs of the command line that write, with their inputs, for `test_write_failures`."""

from __future__ import annotations

import os
import shlex
import shutil
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import write_inputs

from aeromatch.cli import main
from aeromatch.cli.actions import verbs

DATA = Path(__file__).parents[1] / "data"
C182, T37 = DATA / "c182", DATA / "t37"
FLIGHT = "flight/check_roll.csv"
# Recordings of the T-37 on the ground, near the ground, and with pilot forces.
GROUND = ("t37_61_taxi_turns_slow", "t37_63_coast_down_from_70kt")
PASSES = ("t37_12_low_pass_1p7m", "t37_15_low_pass_9m")
FORCES = ("t37_42_forces_clean_low_speed_5kft", "t37_44_forces_clean_high_speed_5kft")


@dataclass(frozen=True)
class Verb:
    """A command in a folder with inputs, and the files or folders that it writes.

    Names are separated by blanks. ``folder/*`` is each file of the folder by itself. Files with
    random bytes, such as keys, are compared by their length. `before` is called in the process
    before the verb.
    """

    words: str
    inputs: str
    targets: str
    is_random: bool = False
    before: Callable[[], None] | None = None

    def command(self) -> list[str]:
        return shlex.split(self.words)


def reconstruction(names: tuple[str, ...], folder: str) -> str:
    """Return the command that reconstructs recordings of the T-37 into a folder."""
    files = " ".join(f"{T37}/flight/{name}.nc" for name in names)
    sources = f"--names {T37}/names.toml --aircraft {T37}/aircraft.toml"
    return f"flight reconstruct {files} {sources} -o {folder}"


def demonstrate_small() -> None:
    """Let ``aeromatch demo`` work on the project in the folder of the trial."""
    verbs.example_folder = lambda name: Path.cwd()


def do_not_serve() -> None:
    """Let ``aeromatch view`` end where it would wait for requests."""
    import uvicorn

    uvicorn.Server.run = lambda *words, **more: None


VERBS = {
    "set": Verb("set aeromatch.toml title Hallo", "c182", "aeromatch.toml"),
    "trial": Verb(
        "set cases/dutch_roll.toml case.window.0 4.5 --trial cases/trial.toml",
        "c182",
        "cases/trial.toml",
    ),
    "mark": Verb(
        "flight mark manoeuvres.csv cruise --kind doublet --control elevator --span 1 2",
        "c182",
        "manoeuvres.csv",
    ),
    "convert": Verb(f"flight convert {FLIGHT} --names names.toml -o r.nc", "c182", "r.nc"),
    "cut": Verb("flight cut r.nc 2 5 -o cut.nc", "r.nc", "cut.nc"),
    "manoeuvres": Verb(
        f"flight manoeuvres {FLIGHT} --names names.toml --find -o m.csv --figure m.png",
        "c182",
        "m.csv m.png",
    ),
    "reconstruct": Verb(
        "flight reconstruct r.nc --aircraft aircraft.toml -o p.nc --figure p.png",
        "r.nc",
        "p.nc p.png",
    ),
    "reconstruct several": Verb(
        f"flight reconstruct {FLIGHT} flight/check_dutch_roll.csv --names names.toml "
        "--aircraft aircraft.toml -o paths -j1",
        "c182",
        "paths",
    ),
    "identify": Verb(
        "flight identify p.nc --aircraft aircraft.toml --model CY=1+beta -o fit.nc",
        "p.nc",
        "fit.nc",
    ),
    "select": Verb(
        (
            "flight select p.nc --aircraft aircraft.toml --coefficient CY --variables 'beta phat "
            "rhat' -o s.nc"
        ),
        "p.nc",
        "s.nc",
    ),
    "validate": Verb(
        "flight validate fit.nc --path p.nc --aircraft aircraft.toml -o board.csv",
        "fit.nc",
        "board.csv",
    ),
    "design": Verb("flight design design.toml -o design", "c182", "design"),
    "coefficients": Verb("db coefficients c182.a4.st -o numbers.csv", "avl", "numbers.csv"),
    "from-estimate": Verb(
        "db from-estimate aircraft.toml c182.a0.st c182.a4.st --length-unit ft --CD0 0.02 "
        "--control elevator=+delta_e --control aileron=+delta_a --control rudder=-delta_r "
        "-o avl.nc",
        "avl",
        "avl.nc",
    ),
    "check": Verb(
        f"flight check {FLIGHT} --names names.toml --aircraft aircraft.toml -o q.html",
        "c182",
        "q.html",
    ),
    "plot a record": Verb("flight plot r.nc -o r.png", "r.nc", "r.png"),
    "datcom cells": Verb("datcom cells datcom/aileron.out -o c.csv", "c182", "c.csv"),
    "datcom convert": Verb("datcom convert datcom/aileron.out -o a.nc", "c182", "a.nc"),
    "datcom deck": Verb("datcom deck datcom/c182_study.inp -o d.dcm", "c182", "d.dcm"),
    "datcom draw": Verb("datcom draw datcom/c182_study.inp -o d.svg", "c182", "d.svg"),
    "datcom export": Verb("datcom export datcom/clean.out -o e.mat", "c182", "e.mat"),
    "datcom split": Verb("datcom split datcom/c182_study.inp -o split", "c182", "split"),
    "build": Verb("db build aircraft.toml datcom/clean.out -o db.nc", "c182", "db.nc"),
    "scale": Verb("db edit db.nc scale CL/basic --by 1.1 -o e.nc", "db.nc", "e.nc"),
    "edit": Verb("db edit db.nc scale CL/basic --by 1.1 -o db.nc", "db.nc", "db.nc"),
    "previous": Verb("db previous e.nc -o old.nc", "e.nc", "old.nc"),
    "forget": Verb("db forget e.nc -o e.nc", "e.nc", "e.nc"),
    "rescale": Verb(
        # the laws of similarity do not scale the propeller of the C182
        "db rescale jet.nc jet.toml --length-ratio 1.2 -o big.nc --aircraft-output big.toml",
        "stalls",
        "big.nc big.toml",
    ),
    "plot a term": Verb("db plot db.nc --term CL/basic -o f.png", "db.nc", "f.png"),
    "figures": Verb("db figures db.nc --lr743 --aircraft aircraft.toml -o figs", "db.nc", "figs"),
    "tabulate": Verb("flight tabulate fit.nc --database db.nc -o t.nc", "fit.nc db.nc", "t.nc"),
    "import": Verb("db import model.xml -o i.nc", "model.xml", "i.nc"),
    "import an aircraft": Verb(
        "db import-aircraft model.xml -o ac.nc --force", "model.xml", "ac.nc ac.toml"
    ),
    "export a folder": Verb("db export db.nc -o tables --to csv", "db.nc", "tables"),
    "export daveml": Verb("db export db.nc -o db.dml --to daveml", "db.nc", "db.dml"),
    "export jsbsim": Verb(
        # JSBSim has no chart of power, as the engine of the C182 has
        "db export jet.nc -o model.xml --to jsbsim --aircraft jet.toml",
        "stalls",
        "model.xml",
    ),
    "export matlab": Verb("db export db.nc -o db.mat --to matlab", "db.nc", "db.mat"),
    "fmu": Verb("fmu write aircraft.toml db.nc -o m.fmu", "db.nc", "m.fmu"),
    "simulate": Verb(
        "fmu simulate aircraft.toml db.nc --inputs inputs.csv -o s.nc", "db.nc", "s.nc"
    ),
    "pom init": Verb(
        f"pom init {FLIGHT} --test 2.d.7 --names names.toml --aircraft aircraft.toml -o c.toml",
        "c182",
        "c.toml",
    ),
    "pom run": Verb(
        "pom run cases/dutch_roll.toml --model m=m.fmu --no-pdf -o rep -j1", "m.fmu", "rep"
    ),
    "resume": Verb(
        "pom run cases/dutch_roll.toml --model m=m.fmu --no-pdf -o rep --resume kept -j1",
        "m.fmu",
        "rep",
    ),
    "pom report": Verb("pom report rep -o again --no-pdf", "rep", "again"),
    "tolerances": Verb("pom tolerances --write t.csv", "c182", "t.csv"),
    "pom schema": Verb("pom schema -o s.json", "c182", "s.json"),
    "schema": Verb("schema project -o p.json", "c182", "p.json"),
    "init": Verb(
        f"init new --records {FLIGHT} --names names.toml",
        "c182",
        "new/cases new/aeromatch.toml new/aircraft.toml new/manoeuvres.csv "
        "new/.draft/aeromatch.toml new/.draft/aircraft.toml new/.draft/manoeuvres.csv "
        "new/.draft/answers.json",
    ),
    "example": Verb("example c182 new --inputs-only", "c182", "new"),
    "blend": Verb("db edit db.nc blend e.nc CL/basic -o b.nc", "db.nc e.nc", "b.nc"),
    "ice": Verb("db edit db.nc ice ice.toml -o b.nc", "db.nc", "b.nc"),
    "delete": Verb("db edit db.nc delete CL/basic -o b.nc", "db.nc", "b.nc"),
    "extend": Verb("db edit db.nc extend CL/basic --axis 'alpha=40 deg' -o b.nc", "db.nc", "b.nc"),
    "move-reference": Verb("db edit db.nc move-reference --x -2.1 -o b.nc", "db.nc", "b.nc"),
    "regrid": Verb(
        "db edit db.nc regrid CL/basic --axis 'alpha=0 4 8 deg' -o b.nc", "db.nc", "b.nc"
    ),
    "replace": Verb("db edit db.nc replace e.nc CL/basic -o b.nc", "db.nc e.nc", "b.nc"),
    "set a node": Verb("db edit db.nc set CL/qhat --value 5 -o b.nc", "db.nc", "b.nc"),
    "shift": Verb("db edit db.nc shift CL/basic --by 0.01 -o b.nc", "db.nc", "b.nc"),
    "datcom run": Verb(
        "datcom run datcom/c182_study.inp --program ./datcom.sh -o ran", "c182", "ran"
    ),
    "datcom plot": Verb(
        "datcom plot no_first_page.for013 --listing no_first_page.out -o fine.nc",
        "listing",
        "fine.nc",
    ),
    "fit-linear": Verb(
        "flight fit-linear p.nc --motion lateral --window 2 6 -o lat.nc", "p.nc", "lat.nc"
    ),
    "balance": Verb(
        "flight balance tail_1.csv tail_2.csv --setup balance.toml --model 'CL = 1 + alpha' "
        "-o fits --figure fits.png",
        "tunnel",
        "fits fits.png",
    ),
    "balance at set points": Verb(
        "flight balance tail_1.csv tail_2.csv --setup balance.toml --table points "
        "--step '2 deg' --x-ref '0 m'",
        "tunnel",
        "points",
    ),
    "markers": Verb(
        "flight markers cameras.csv --setup markers.toml -o body.nc", "cameras", "body.nc"
    ),
    "diagnose": Verb(
        "pom diagnose cases/dutch_roll.toml --prior e.nc --final db.nc --apriori aircraft.toml "
        "--replays 8 -j1 -o c.nc --aircraft-output c.toml",
        "db.nc e.nc",
        "c.nc c.toml",
    ),
    "match": Verb("match aeromatch.toml -o out --resume kept -j1", "small", "out/*"),
    "reconstruct all": Verb("match aeromatch.toml -o paths -j1 --paths", "small", "paths/*"),
    "demo": Verb("demo -o out -j1", "small", "out/*", before=demonstrate_small),
    "view": Verb("view aeromatch.toml -o work --no-browser", "c182", "work/*", True, do_not_serve),
    "package key": Verb("package key my.key", "c182", "my.key my.key.pub", True),
    "package make": Verb("package make aeromatch.toml out -o c182.zip", "out", "c182.zip"),
    "package folder": Verb("package make aeromatch.toml out -o c182", "out", "c182"),
    "envelope": Verb("db envelope out/final.nc -o env.csv", "out", "env.csv"),
    "draw an envelope": Verb("db envelope out/final.nc -o env.svg", "out", "env.svg"),
    "compare": Verb("db compare db.nc e.nc --figures figs", "db.nc e.nc", "figs"),
    "junit": Verb(
        "pom run cases/dutch_roll.toml --model m=m.fmu --junit j.xml -j1", "m.fmu", "j.xml"
    ),
    "tune": Verb(
        "pom tune cases/short_period.toml --database out/datcom.nc --aircraft out/datcom.toml "
        "-o tuned --log tuning.json --fmu --resume kept -j1",
        "out",
        "tuned tuning.json",
    ),
    "spread": Verb(
        f"pom spread catalogue.toml --database few.nc --aircraft {T37}/aircraft.toml -o rows.nc "
        "-j1",
        "few.nc",
        "rows.nc",
    ),
    "plan": Verb(
        f"flight plan plan.toml --database few.nc --aircraft {T37}/aircraft.toml -o plan "
        "--draws 2 -j1",
        "few.nc",
        "plan",
    ),
    "fit": Verb(
        "flight fit fit.toml -o f.nc --page f.html --database f_db.nc",
        "p.nc db.nc",
        "f.nc f.html f_db.nc",
    ),
    "report": Verb(
        "flight report glider/plan.toml -o page.html --save saved", "glider", "page.html saved"
    ),
    "actuator": Verb(
        "flight actuator servo_1.csv --position 'angle [deg]' --held --figure servo.png",
        "actuator_bench",
        "servo.png",
    ),
    "multibody": Verb(
        "flight multibody flight_1.csv --vehicle vehicle.toml --model 'CL = 1 + w + q' "
        "--figure wings.png -o wings",
        "tail_fits vehicle",
        "wings wings.png",
    ),
    "engine": Verb(
        "flight engine --points points.csv --prior prior_deck.nc -o deck.nc", "points", "deck.nc"
    ),
    "gear": Verb(
        f"flight gear ground/{GROUND[0]}.nc ground/{GROUND[1]}.nc --aircraft {T37}/apriori.toml "
        "--no-flown -o gear.toml",
        "ground",
        "gear.toml gear_engine1.nc",
    ),
    "ground-effect": Verb(
        f"flight ground-effect passes/{PASSES[0]}.nc passes/{PASSES[1]}.nc "
        f"--aircraft {T37}/aircraft.toml --database few.nc --model 'CL = 1 + alpha' -o ge.nc",
        "passes few.nc",
        "ge.nc",
    ),
    "controls": Verb(
        f"flight controls forces/{FORCES[0]}.nc forces/{FORCES[1]}.nc --constant offset "
        "--constant bob_weight --constant friction --constant damping "
        f"--aircraft {T37}/aircraft.toml -o circuit.toml --database few.nc --into hinge.nc",
        "forces few.nc",
        "circuit.toml circuit_engine1.nc hinge.nc",
    ),
    "stall": Verb(
        "flight stall slow.nc fast.nc --aircraft jet.toml --database jet.nc --coefficient CL "
        "--into stalling.nc -o stalling.toml --figure loops.svg",
        "stalls",
        "stalling.nc stalling.toml loops.svg",
    ),
    "estimate": Verb("db estimate aircraft.toml short.inp -o optvl.nc", "short.inp", "optvl.nc"),
}
# Extras of verbs; a verb without its extra is not tried.
EXTRAS = {"estimate": "optvl", "view": "uvicorn", "package key": "cryptography"}
# Verbs that make the inputs of others.
MAKERS = {
    "r.nc": "convert",
    "e.nc": "scale",
    "fit.nc": "identify",
    "model.xml": "export jsbsim",
    "p.nc": "reconstruct",
    "db.nc": "build",
    "m.fmu": "fmu",
    "rep": "pom run",
    "out": "match",
    "tail_fits": "tail",
    "prior.nc": "build T-37",
    "ground": "reconstruct on the ground",
    "passes": "reconstruct near the ground",
    "forces": "reconstruct with pilot forces",
}
# Verbs that only make inputs; others of the same kind are tried.
HELPERS = {
    "tail": Verb(
        "flight balance tail_1.csv tail_2.csv --setup balance.toml "
        "--model 'CL = 1 + alpha + alpha*beta' --model 'CD = 1 + alpha**2' -o tail_fits",
        "tunnel",
        "",
    ),
    "build T-37": Verb(f"db build {T37}/aircraft.toml {T37}/datcom -o prior.nc", "", ""),
    "reconstruct on the ground": Verb(reconstruction(GROUND, "ground"), "", ""),
    "reconstruct near the ground": Verb(reconstruction(PASSES, "passes"), "", ""),
    "reconstruct with pilot forces": Verb(reconstruction(FORCES, "forces"), "", ""),
}


def run_verb(words: list[str]) -> int:
    """Run the command line in this process, and return its exit code."""
    sys.argv = ["aeromatch", *words]
    try:
        main()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(bool(end.code))
    return 0


def make_inputs(names: str, folder: Path) -> None:
    """Fill a folder with the inputs of a verb, in their order."""
    shutil.copytree(C182, folder, dirs_exist_ok=True)
    for file, text in write_inputs.TEXTS.items():
        (folder / file).write_text(text)
        (folder / file).chmod(0o700 if file.endswith(".sh") else 0o600)
    for name in names.split():
        if name in write_inputs.COPIED:
            shutil.copytree(write_inputs.COPIED[name], folder, dirs_exist_ok=True)
        elif name in MAKERS:
            verb = (VERBS | HELPERS)[MAKERS[name]]
            make_inputs(verb.inputs, folder)
            os.chdir(folder)
            assert run_verb(verb.command()) in (0, 1), name
        elif name != "c182":
            if name == "few.nc":
                make_inputs("prior.nc", folder)
            write_inputs.WRITERS[name](folder)
