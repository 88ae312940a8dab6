"""The displacement of the TCP by a result's offsets: closed forms, and nothing where it is not known."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from starlette.testclient import TestClient

import zerobeam as zb

Change = Callable[[dict[str, Any]], object]


@pytest.fixture
def asked(client: TestClient, root: Path, reported: Path) -> Callable[..., Any]:
    """What the page gets of the good result, changed."""
    shutil.copytree(reported, root, dirs_exist_ok=True)
    file = root / "good/result.json"

    def answer(*changes: Change) -> Any:
        content = json.loads(file.read_text())
        for change in changes:
            change(content)
        file.write_text(json.dumps(content))
        return client.get("/api/result", params={"file": "good/result.json"}).json()

    return answer


def _offsets(**values: float | None) -> Change:
    """Offsets of these values and no others; None is not determined."""

    def change(content: dict[str, Any]) -> None:
        for row in content["parameters"]:
            if row["group"] == "offset":
                value = values.get(row["name"], 0.0)
                row |= {"held": False, "status": "identified", "estimate": value, "std": 0.01}
                row["interval95"] = None if value is None else [value - 0.02, value + 0.02]
                if value is None:
                    row |= {
                        "status": "unidentifiable",
                        "std": None,
                        "midpoint": None,
                        "tolerance_share": None,
                    }
        content |= {"intervals": [], "budget": [], "without_prior": None, "outlook": None}
        content["posterior"]["parameters"] = None
        if None in values.values():
            content["verdict"] = "degenerate"

    return change


def _entered(**values: str) -> Change:
    def change(content: dict[str, Any]) -> None:
        content["next_steps"]["enter"] = [
            {"name": name, "value": value, "expanded_u": "0.02°"} for name, value in values.items()
        ]

    return change


def _exact(content: dict[str, Any]) -> None:
    content["inputs"]["header"]["geometry"] = "exact"


def _lengths(shown: Any, which: str) -> np.ndarray[Any, Any]:
    return np.array([np.linalg.norm(one[which]) for one in shown["tcp_map"]])


def test_a_turn_of_joint_1_moves_the_tcp_by_its_radius(asked: Callable[..., Any]) -> None:
    shown = asked(_offsets(delta1=0.1))
    at = np.array([one["at"] for one in shown["tcp_map"]])
    chords = 2 * np.hypot(at[:, 0], at[:, 1]) * np.sin(np.radians(0.1) / 2)
    assert _lengths(shown, "before") == pytest.approx(chords, rel=1e-9)
    assert chords.min() > 0.5
    for one in shown["tcp_map"]:  # counter-clockwise about z, as the joint turns
        assert np.cross([*one["at"][:2], 0], one["before"])[2] > 0
        assert one["before"][2] == pytest.approx(0, abs=1e-9)
    assert shown["tcp"]["before"] == pytest.approx(np.median(chords), rel=1e-9)


def test_before_is_from_where_the_controller_has_it_to_where_it_is(
    asked: Callable[..., Any], root: Path
) -> None:
    shown = asked()
    stated = json.loads((root / "good/result.json").read_text())
    run = zb.read_run(root / "good.jsonl")
    delta = [row["estimate"] for row in stated["parameters"] if row["group"] == "offset"]
    point = np.array([*stated["accuracy"]["point_mm"], 1.0])
    assert len(shown["tcp_map"]) == len(run.shots) == len(shown["skeletons"]) == len(shown["residuals"])
    for one, shot, residual in zip(shown["tcp_map"], run.shots, shown["residuals"], strict=True):
        joints = np.array(shot.joints_deg)
        assert residual["shot"] == shot.shot
        assert one["at"] == pytest.approx((run.robot.fk(joints, "deg") @ point)[:3].tolist())
        true = (run.robot.fk(joints + delta, "deg") @ point)[:3]
        assert np.add(one["at"], one["before"]) == pytest.approx(true)
    # Links are estimated as well: what the values leave is an expectation.
    assert all(one["after"] is None for one in shown["tcp_map"])
    assert shown["tcp"]["after"] is None
    assert "links" in shown["tcp_why"]


def test_of_an_exact_arm_what_rounding_leaves_is_known(asked: Callable[..., Any]) -> None:
    shown = asked(_offsets(delta1=-0.1234), _entered(delta1="−0.12°"), _exact)
    at = np.array([one["at"] for one in shown["tcp_map"]])
    chords = 2 * np.hypot(at[:, 0], at[:, 1]) * np.sin(np.radians(0.0034) / 2)
    assert _lengths(shown, "after") == pytest.approx(chords, rel=1e-3)
    assert shown["tcp_why"] is None
    assert all(one["after"] is None for one in asked(_entered())["tcp_map"])


def test_what_is_not_determined_has_no_vector(asked: Callable[..., Any]) -> None:
    shown = asked(_offsets(delta3=None), lambda content: content.update(verdict="degenerate"), _entered())
    assert all(one["before"] is one["after"] is None for one in shown["tcp_map"])
    assert shown["tcp"] is None
    assert "J3" in shown["tcp_why"]


def test_an_undetermined_offset_that_moves_no_tcp_hides_nothing(asked: Callable[..., Any]) -> None:
    """The TCP on the axis of joint 6: z of the built-in arm's last frame."""

    def on_axis(content: dict[str, Any]) -> None:
        content["accuracy"]["point_mm"] = [0.0, 0.0, 65.0]

    degenerate: Change = lambda content: content.update(verdict="degenerate")  # noqa: E731
    shown = asked(_offsets(delta2=0.1, delta6=None), degenerate, _entered(), on_axis)
    assert _lengths(shown, "before").min() > 0.1
    shown = asked(lambda content: content["accuracy"].update(point_mm=[30.0, 0.0, 65.0]))
    assert all(one["before"] is None for one in shown["tcp_map"])


def test_without_its_run_residuals_alone_are_shown(asked: Callable[..., Any], root: Path) -> None:
    asked()
    (root / "good.jsonl").unlink()
    (root / "run.jsonl").unlink()
    shown = asked()
    assert shown["tcp_map"] is None
    assert "not in the folder" in shown["tcp_why"]
    assert shown["residuals"]
