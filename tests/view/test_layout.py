"""The layout of a view in its address: what is written is read again, and what is malformed changes nothing."""

import pytest

from tiago_mj.view import layout

MALFORMED = (
    "effects=backlash~all~width:nan;nothing~all~;backlash;~~;coulomb_friction~nobody~force:1",
    "effects=" + "x" * 5000,
    "&".join(f"over={k}" for k in range(200)),
    "over=<script>alert(1)</script>&speed=%00&policy=../../secret.zip&joint=%E2%82%AC",
    "camera=1,2,3&time=soon&paused=&larger=1e9&where=there&recording=no-such",
    "camera=nan,0,0,0,0,0&camera=inf,1,1,1,1,1",
    "%",
    "?",
)


def test_parts_are_read_as_they_were_written():
    parts = {"over": "reward,force-left-n", "camera": layout.rounded([0.5, -1.25, 1e-3, 0, 0, 0]), "paused": "yes"}
    text = layout.write(parts)
    assert layout.read(f"?{text}&darkMode&unknown=1") == parts
    assert layout.numbers(parts["camera"], 6) == (0.5, -1.25, 1e-3, 0, 0, 0)


def test_effects_are_read_as_they_were_written():
    effects = (
        layout.EffectText("coulomb_friction", "all", {"force": 2.5e-07}),
        layout.EffectText("payload", "hand.a", {"mass": 1e6, "x": -0.02}, acts=False),
        layout.EffectText("dead_zone", "all", {}),
    )
    text = layout.write_effects(effects)
    assert layout.SAFE.fullmatch(text)
    assert layout.read_effects(layout.read(f"effects={text}")["effects"]) == effects


def test_labels_that_are_alike_stay_apart():
    labels = ["torque [N·m]", "torque [N m]", "力", "位"]
    assert list(layout.slugs(labels).values()) == labels
    assert all(layout.SAFE.fullmatch(layout.slug(label, labels)) for label in labels)


@pytest.mark.parametrize("query", MALFORMED)
def test_what_is_malformed_is_left_out(query):
    for key, value in layout.read(query).items():
        assert key in layout.KEYS
        assert layout.SAFE.fullmatch(value)
        assert all(abs(v) < float("inf") for one in layout.read_effects(value) for v in one.values.values())


def test_an_environment_is_laid_out_as_its_address_says():
    pytest.importorskip("viser")
    from tiago_mj.view.live import Live
    from tiago_mj.view.server import serving
    from tiago_mj.view.session import session

    watched = session("GripperTactile-v0")
    with serving(0, "one") as first, serving(0, "two") as second:
        live = Live(first, watched)
        live._apply(
            layout.read(
                "over=force-left-n,nothing&joint=right-finger&policy=pi&speed=1-10&paused=yes&hidden=nominal"
                "&effects=backlash~gripper_left_finger_joint~width:0.002;coulomb_friction~all~force:1000~off"
            )
        )
        live.tick()
        there = live._layout()
        assert there["over"] == "force-left-n,nothing"
        assert (there["policy"], there["speed"], there["paused"], there["hidden"]) == ("pi", "1-10", "yes", "nominal")
        assert [(one.name, one.target) for one in watched.effects] == [("backlash", ("gripper_left_finger_joint",))]
        friction = layout.read_effects(there["effects"])[1]
        assert not friction.acts
        assert 0 < friction.values["force"] < 1000, "no more than a slider has"
        for query in MALFORMED[1:]:
            live._apply(layout.read(query))
        assert live._layout() == there
        other = session("GripperTactile-v0")
        again = Live(second, other)
        again._apply(layout.read(layout.write(there)))
        assert again._layout() == there
        other.close()
    watched.close()


def test_recordings_are_laid_out_as_their_address_says(known):
    pytest.importorskip("viser")
    from tiago_mj.view.player import Player
    from tiago_mj.view.server import serving

    with serving(0, "one") as first, serving(0, "two") as second:
        player = Player(first, ["pi-000", "pi-001"], known.story, "pi-001")
        player._apply(
            layout.read("recording=pi-000&time=0.5&paused=yes&where=side-by-side&larger=2&hidden=repaired&speed=1-2")
        )
        there = player._layout()
        assert there["recording"] == player.stage.story.signals.trial == "pi-000"
        assert (there["time"], there["paused"], there["larger"], there["hidden"]) == ("0.5", "yes", "2", "repaired")
        assert player.stage.beside
        for query in MALFORMED:
            player._apply(layout.read(query))
        assert player._layout() == there
        again = Player(second, ["pi-000", "pi-001"], known.story, "pi-001")
        again._apply(layout.read(layout.write(there)))
        assert again._layout() == there
