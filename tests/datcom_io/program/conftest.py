"""The real Digital DATCOM program, which is not part of the project, and decks of our own for
it.
"""

import os
from pathlib import Path

import pytest

import datcom_io

ROOT = Path(__file__).parents[3]
VARIABLE = "AEROMATCH_DATCOM"

PARTS = {
    "flight": """ $FLTCON LOOP=2.0,NMACH=1.0,MACH(1)=0.15,NALT=1.0,ALT(1)=0.0,NALPHA=5.0,
   ALSCHD(1)=-4.0,0.0,4.0,8.0,12.0$
 $OPTINS SREF=24.2,CBARR=2.022,BLREF=13.36$
 $SYNTHS XCG=6.3,ZCG=-0.15,XW=5.42,ZW=-0.55,ALIW=2.5,XH=11.31,ZH=0.9,ALIH=0.5,
   XV=10.1,ZV=0.55,SCALE=1.0,VERTUP=.TRUE.$
""",
    "body": """ $BODY NX=12.0,BNOSE=2.0,BTAIL=1.0,BLN=2.7,BLA=5.8,ITYPE=1.0,METHOD=1.0,
   X(1)=0.0,0.4,0.9,1.8,2.7,4.5,6.5,8.5,10.0,11.3,12.4,13.2,R(1)=0.0,0.3,0.5,
   0.72,0.815,0.815,0.815,0.8,0.66,0.45,0.25,0.06$
""",
    "wing": """ $WGPLNF CHRDR=2.86,CHRDTP=0.762,SSPN=6.68,SSPNE=5.9,SAVSI=1.4,CHSTAT=0.25,
   SWAFP=0.0,TWISTA=-3.0,SSPNDD=0.0,DHDADI=4.0,DHDADO=0.0,TYPE=1.0$
NACA W 5 23014
""",
    "tail": """ $HTPLNF CHRDR=1.5,CHRDTP=0.75,SSPN=2.895,SSPNE=2.8,SAVSI=5.0,CHSTAT=0.25,
   SWAFP=0.0,TWISTA=0.0,SSPNDD=0.0,DHDADI=9.0,DHDADO=0.0,TYPE=1.0$
 $VTPLNF CHRDR=2.45,CHRDTP=1.1,SSPN=2.75,SSPNE=2.45,SAVSI=33.0,CHSTAT=0.25,
   SWAFP=0.0,TWISTA=0.0,TYPE=1.0$
NACA H 4 0010
NACA V 4 0012
""",
    "ground": " $GRNDEF NGH=3.0,GRDHT(1)=1.7,3.0,6.0$\n",
    "ailerons": """ $ASYFLP STYPE=4.0,NDELTA=3.0,DELTAL(1)=-20.0,0.0,20.0,DELTAR(1)=15.0,0.0,-15.0,
   CHRDFI=0.48,CHRDFO=0.3,SPANFI=4.0,SPANFO=6.4,PHETE=0.0522$
""",
    "elevator": """ $SYMFLP FTYPE=1.0,NDELTA=3.0,DELTA(1)=-20.0,0.0,10.0,PHETE=0.0522,PHETEP=0.0391,
   CHRDFI=0.52,CHRDFO=0.3,SPANFI=0.15,SPANFO=2.85,CB=0.1,TC=0.09,NTYPE=1.0$
""",
    "jet power": """ $JETPWR NENGSJ=2.0,AIETLJ=0.0,THSTCJ=0.08,JIALOC=7.4,JELLOC=1.3,JEVLOC=0.65,
   JEALOC=9.6,JINLTA=0.19,JEANGL=10.0,JEVELO=300.0,AMBTMP=288.15,JESTMP=480.0,
   JETOTP=145000.0,AMBSTP=101325.0,JERAD=0.22$
""",
    "transverse jet": """ $FLTCON NMACH=1.0,MACH(1)=12.0,RNNUB(1)=500000.0,ALT(1)=150000.0,NALT=1.0$
 $TRNJET TIME(1)=0.0,1.0,2.0,3.0,NT=4.0,FC(1)=100.0,200.0,300.0,250.0,
   ALPHA(1)=0.0,2.0,4.0,6.0,LAMNRJ(1)=.TRUE.,.TRUE.,.FALSE.,.FALSE.,ME=3.0,
   ISP=250.0,SPAN=1.0,PHE=10.0,GP=1.3,CC=1.0,LFP=6.0$
""",
    "hypersonic body": """ $FLTCON NMACH=2.0,MACH(1)=6.0,10.0,NALT=2.0,ALT(1)=90000.0,110000.0,LOOP=1.0,
   NALPHA=7.0,ALSCHD(1)=0.0,2.0,4.0,6.0,8.0,10.0,12.0,HYPERS=.TRUE.$
 $OPTINS SREF=20.0,CBARR=12.0,BLREF=5.0$
 $SYNTHS XCG=6.0,ZCG=0.0$
 $BODY NX=6.0,BNOSE=1.0,BTAIL=1.0,BLN=8.0,BLA=4.0,DS=0.2,X(1)=0.0,2.0,4.0,8.0,
   10.0,12.0,R(1)=0.0,0.4,0.8,1.6,1.4,1.0$
""",
}


@pytest.fixture(scope="session")
def program():
    """Return the path of the program."""
    path = Path(os.environ.get(VARIABLE) or ROOT / "build" / "datcom" / "datcom")
    if not path.is_file():
        pytest.skip(
            f"the Digital DATCOM program is not built: "
            f"../shared/tools/digital_datcom/build.sh build/datcom, or {VARIABLE}=PATH"
        )
    return path


@pytest.fixture
def parts():
    """Return the texts of an aircraft, its devices and its conditions, in metres."""
    return dict(PARTS)


@pytest.fixture
def run(program, tmp_path):
    """Return a function that runs the text of a deck and returns the `Run`."""

    def perform(*texts: str, name: str = "deck"):
        folder = tmp_path / name
        folder.mkdir()
        (folder / f"{name}.inp").write_text("".join(texts))
        return datcom_io.run_deck(folder / f"{name}.inp", program)

    return perform
