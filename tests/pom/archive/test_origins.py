import hashlib

import pom


def test_inputs_are_named_from_their_common_folder(tmp_path):
    (tmp_path / "a" / "deep").mkdir(parents=True)
    files = [tmp_path / "a" / "one.toml", tmp_path / "a" / "deep" / "two.nc"]
    for file in files:
        file.write_text(file.name)
    fmu = tmp_path / "model.fmu"
    fmu.write_bytes(b"zip")
    found = pom.provenance(
        [*files, tmp_path / "a" / "deep" / ".." / "one.toml"], {"final": fmu}, "aeromatch pom run"
    )
    assert found["inputs"] == {
        "deep/two.nc": hashlib.sha256(b"two.nc").hexdigest(),
        "one.toml": hashlib.sha256(b"one.toml").hexdigest(),
    }
    assert found["places"] == {"deep/two.nc": str(files[1]), "one.toml": str(files[0])}
    assert found["models"] == {
        "final": {
            "file": "model.fmu",
            "sha256": hashlib.sha256(b"zip").hexdigest(),
            "path": str(fmu),
        }
    }
    assert found["command"] == "aeromatch pom run"
    assert set(found["versions"]) >= {"aeromatch", "numpy"}


def test_a_report_states_the_sandbox_of_its_fmus(tmp_path, monkeypatch):
    fmu = tmp_path / "model.fmu"
    fmu.write_bytes(b"zip")
    monkeypatch.setenv("AEROMATCH_FMU_SANDBOX", "none")
    stated = pom.provenance([], {"final": fmu})["versions"]["sandbox of the FMUs"]
    assert stated == "none (AEROMATCH_FMU_SANDBOX is 'none')"
    monkeypatch.delenv("AEROMATCH_FMU_SANDBOX")
    monkeypatch.setenv("PATH", "")
    stated = pom.provenance([], {"final": fmu})["versions"]["sandbox of the FMUs"]
    assert stated == "none (the program bwrap is missing)"
    assert "sandbox of the FMUs" not in pom.provenance([], {})["versions"]
