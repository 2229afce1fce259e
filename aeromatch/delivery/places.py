"""Names of the files of a data package, and the format that its manifest states."""

CONTENT = "aeromatch data package, format 1"
MANIFEST, SIGNATURE = "manifest.json", "manifest.sig"
README, LICENCE = "README.md", "LICENCE.md"
ROADMAP, RECORDINGS = "roadmap.csv", "recordings.csv"
FLOWN, STATES = "check_cases/flown", "check_cases/states.csv"
# These are left out only if the manifest states the reason.
FORMATS = (
    "database/final.mat",
    "database/final_csv",
    "database/final.dml",
    "database/final_jsbsim.xml",
    FLOWN,
)
STATE_COUNT = 200
"""Number of check cases of the database."""
