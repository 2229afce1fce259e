"""A report proves one model: another FMU under its name is a departure."""

from types import SimpleNamespace

from pom.checking.model_identity import identity_remarks


def result(**models):
    attrs = {f"model.{run}": origin for run, origin in models.items()}
    return SimpleNamespace(runs=(*models,), signals=SimpleNamespace(attrs=attrs))


def flown(digit):
    return f"m.fmu, FMI 3.0, sha256 {digit * 64}"


def test_another_file_under_the_name_of_a_model_is_named():
    results = [result(m=flown("a")), result(m=flown("b")), result(m=flown("b"), other=flown("c"))]
    first, second, third = identity_remarks(results)
    (remark,) = first["m"]
    assert remark.kind == "departure"
    assert "model m (sha256 aaaaaaaaaaaa) is another file in 2 other cases of the" in remark.text
    # none of the two files is proven by all cases
    for found in (second, third):
        assert list(found) == ["m"]
        assert "(sha256 bbbbbbbbbbbb) is another file in 1 other case of the" in found["m"][0].text


def test_recordings_of_a_device_are_a_file_for_each_case():
    recordings = [
        result(d=f"{name}.csv, recording, sha256 {name * 64}", m=flown("a")) for name in "ab"
    ]
    assert identity_remarks(recordings) == [{}, {}]
