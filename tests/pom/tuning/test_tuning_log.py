"""The table of a tuning lists what a reader has to judge."""

from pom.diagnosis.tuning.tuning_log import moves_of, outcome_sentence


def move(term, moved, share, from_evidence=0.0, rationale=""):
    return {
        "term": term,
        "moved": moved,
        "from_evidence": from_evidence,
        "share": share,
        "nodes": 3,
        "at": "",
        "rationale": rationale,
    }


def test_a_bound_beyond_three_standard_errors_is_a_departure():
    log = {
        "refusal": "",
        "moves": [move("Cm/elevator", 8.8, 1.0)],
        "rows": [{"case": "pulse", "wanted": True}],
        "distance": 8.8,
    }
    assert outcome_sentence({**log, "bound": 3.0}).endswith("; bound 3")
    wide = outcome_sentence({**log, "bound": 200.0})
    assert "bound 200 is a departure: beyond 3 standard errors" in wide


def test_small_moves_are_counted_and_not_listed():
    small = [move(f"Cm/t{k}", 0.3 - 0.01 * k, 0.0005) for k in range(20)]
    log = {"moves": [move("Cm/qhat", 1.4, 0.98), move("Cm/elevator", 0.2, -0.02), *small]}
    rows, remark = moves_of(log)
    assert [cells[0] for cells in rows] == ["Cm/qhat", "Cm/elevator"]
    assert [cells[3] for cells in rows] == ["98 %", "-2 %"]
    assert remark == (
        "20 further terms, each with less than 1 % of the distance and less than 0.5 standard "
        "errors: the largest move is 0.30 standard errors (Cm/t0), together they have 1.0 % of the "
        "distance"
    )


def test_a_large_move_with_a_small_share_is_listed_without_a_zero():
    far = move("CL/gear", 0.1, 0.001, from_evidence=2.5)
    reasoned = move("CL/flap", 0.01, 0.0, rationale="a seal was changed")
    rows, remark = moves_of({"moves": [move("Cm/qhat", 1.4, 0.99), far, reasoned]})
    assert [(cells[0], cells[3]) for cells in rows] == [
        ("Cm/qhat", "99 %"),
        ("CL/gear", "<1 %"),
        ("CL/flap", "<1 %"),
    ]
    assert remark == ""
    assert moves_of({"moves": []}) == ([], "")


def test_the_largest_move_is_always_listed():
    rows, remark = moves_of({"moves": [move("A", 0.02, 0.004), move("B", 0.01, 0.001)]})
    assert [cells[0] for cells in rows] == ["A"]
    assert remark.startswith("1 further term, with less than 1 % of the distance")
