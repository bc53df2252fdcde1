"""Parameters: declared once, strict about names, types and ranges, the same in every file."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.parameters import (
    OLD_NAMES,
    USUAL_NAMES,
    Config,
    NodeConfig,
    Parameter,
    Value,
    load_preset,
    load_yaml,
    parameters,
    parse_assignment,
    share_directory,
    to_markdown,
    to_yaml,
    values,
    with_values,
)

ALL = [*parameters(Config), *parameters(NodeConfig)]
NUMBERS = [p for p in ALL if p.type in {int, float}]
FRAMES = ("odom_frame_id", "frame_id", "guess_frame_id")
PRESETS = sorted((share_directory() / "config").glob("*.yaml"))


def allowed_values(parameter: Parameter) -> st.SearchStrategy[Value]:
    """All values that a parameter takes."""
    if parameter.type is bool:
        return st.booleans()
    if parameter.choices:
        return st.sampled_from(parameter.choices)
    low, high = parameter.minimum, parameter.maximum
    if parameter.type is int:
        limits = (None if limit is None else round(limit) for limit in (low, high))
        return allowed_numbers(st.integers(*limits), parameter)
    if parameter.type is float:
        return allowed_numbers(st.floats(low, high, allow_nan=False), parameter)
    if parameter.check is not None:
        texts = ["", "map", "1 2 3 0 0 0", "1, 2, 3, 0, 0, 0, 1"]
        return st.sampled_from([t for t in texts if parameter.check.fault(t) is None])
    return st.text(st.characters(exclude_categories=["C", "Zl", "Zp"]))


def allowed_numbers(
    numbers: st.SearchStrategy[Value], parameter: Parameter
) -> st.SearchStrategy[Value]:
    """Those that pass the parameter's check, if it has one."""
    check = parameter.check
    return numbers if check is None else numbers.filter(lambda n: check.fault(str(n)) is None)


def allowed_changes(config: Config | NodeConfig) -> st.SearchStrategy[dict[str, Value]]:
    """Allowed values of some parameters."""
    strategies = {p.name: allowed_values(p) for p in parameters(config)}
    before = values(config)

    def fit_together(changes: dict[str, Value]) -> bool:
        after = {**before, **changes}
        frames = [after[name] for name in FRAMES if after.get(name)]
        nearest, farthest = after.get("camera.depth_min", 0), after.get("camera.depth_max", 1)
        assert isinstance(nearest, (int, float))
        assert isinstance(farthest, (int, float))
        return len({*frames}) == len(frames) and nearest < farthest

    return st.fixed_dictionaries({}, optional=strategies).filter(fit_together)


@pytest.mark.parametrize("preset", PRESETS, ids=lambda path: path.stem)
def test_a_preset_is_what_the_declarations_render_comments_included(preset: Path) -> None:
    """Render it anew with ``rgbd-glue params --preset <name>``."""
    assert preset.read_text(encoding="utf-8") == to_yaml(load_preset(preset.stem))


def test_the_presets_are_those_that_the_node_offers() -> None:
    (choices,) = (p.choices for p in parameters(NodeConfig) if p.name == "preset")
    assert {path.stem for path in PRESETS} == {*choices}


@pytest.mark.parametrize("parameter", ALL, ids=lambda p: p.name)
def test_a_parameter_is_described_and_its_default_allowed(parameter: Parameter) -> None:
    assert parameter.description.endswith(".")
    assert parameter.convert(parameter.default) == parameter.default
    assert parameter.name in to_markdown(Config()) + to_markdown(NodeConfig())


@pytest.mark.slow
@pytest.mark.parametrize("config", [Config(), NodeConfig()], ids=["registration", "node"])
@given(data=st.data())
@settings(
    max_examples=50, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_every_configuration_survives_its_file(
    config: Config | NodeConfig, data: st.DataObject, tmp_path: Path
) -> None:
    changes = data.draw(allowed_changes(config))
    changed = with_values(config, changes)
    assert values(changed) == {**values(config), **changes}
    path = tmp_path / "params.yaml"
    path.write_text(to_yaml(changed), encoding="utf-8")
    assert load_yaml(path, config) == changed


@pytest.mark.slow
@given(st.from_regex(r"[a-z_.]{1,30}", fullmatch=True))
def test_an_unknown_name_is_refused(name: str) -> None:
    declared = {p.name for p in parameters(Config)}
    if name not in declared:
        with pytest.raises(InputError, match="no such parameter"):
            with_values(Config(), {name: 1})


@pytest.mark.parametrize(
    ("misspelt", "meant"),
    [
        ("glue.K", "glue.k"),
        ("feature.visual", "features.visual"),
        ("odometry.keyframe_translations", "odometry.keyframe_translation"),
    ],
)
def test_a_misspelt_name_is_told_how_it_is_spelt(misspelt: str, meant: str) -> None:
    with pytest.raises(InputError, match=rf"did you mean {meant}\?$"):
        with_values(Config(), {misspelt: 1})


def test_a_section_is_no_parameter() -> None:
    with pytest.raises(InputError, match=r"^glue: no such parameter"):
        with_values(Config(), {"glue": {"k": 3}})


@pytest.mark.parametrize("parameter", NUMBERS, ids=lambda p: p.name)
def test_a_number_out_of_range_is_refused_with_the_range(parameter: Parameter) -> None:
    assert parameter.minimum is not None
    assert parameter.maximum is not None
    outside = [
        *map(parameter.type, (parameter.minimum - 1, parameter.maximum + 1)),
        *([math.nan, math.inf, -math.inf, 1e300] if parameter.type is float else [10**30]),
    ]
    for value in outside:
        with pytest.raises(InputError, match="out of range; give a") as refused:
            parameter.convert(value)
        assert refused.value.where == parameter.name
        assert refused.value.remedy == f"give {parameter.allowed}"


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("glue.filter", 1),
        ("glue.filter", "true"),
        ("seed", True),
        ("seed", 3.0),
        ("seed", "3"),
        ("glue.k", True),
        ("glue.k", "three"),
        ("glue.k", None),
        ("glue.k", [3.0]),
        ("features.visual", 3),
        ("features.visual", False),  # what YAML reads "no" and "off" as
        ("features.visual", "surf"),
    ],
)
def test_a_value_of_another_type_is_refused_with_what_is_allowed(name: str, value: object) -> None:
    with pytest.raises(InputError) as refused:
        with_values(Config(), {name: value})
    (declared,) = (p for p in parameters(Config) if p.name == name)
    assert refused.value.where == name
    assert declared.allowed in refused.value.remedy
    assert "\n" not in str(refused.value)


def test_a_whole_number_is_a_number() -> None:
    config = with_values(Config(), {"glue.k": 3})
    assert isinstance(config.glue.k, float)


def test_a_configuration_is_changed_into_a_new_one() -> None:
    config = Config()
    changed = with_values(config, {"glue.k": 7.0, "seed": 5})
    assert (config, changed.glue.k, changed.seed) == (Config(), 7.0, 5)
    assert changed.ransac is config.ransac


@pytest.mark.parametrize(
    ("text", "name", "value"),
    [
        ("glue.k=3", "glue.k", 3),
        ("glue.k=3.5", "glue.k", 3.5),
        ("glue.filter=false", "glue.filter", False),
        ("features.visual=none", "features.visual", "none"),
        ("frame_id=", "frame_id", ""),
        ("camera_pose=0 0 1 = 2", "camera_pose", "0 0 1 = 2"),
    ],
)
def test_an_assignment_is_a_name_and_a_yaml_value(text: str, name: str, value: object) -> None:
    assert parse_assignment(text) == (name, value)


@given(st.floats(1.0, 100.0))
@example(1e1)
def test_a_number_may_be_assigned_in_any_notation(k: float) -> None:
    for text in (repr(k), f"{k:e}", f"{k:.0e}"):
        config = with_values(Config(), dict([parse_assignment(f"glue.k={text}")]))
        assert config.glue.k == float(text)


@pytest.mark.parametrize("text", ["glue.k", "=3", "", "glue.k={", "glue.k='"])
def test_what_is_no_assignment_is_refused_with_an_example_or_advice(text: str) -> None:
    with pytest.raises(InputError, match=r"^--set ") as refused:
        parse_assignment(text)
    assert refused.value.remedy


@pytest.mark.parametrize(
    ("content", "cause"),
    [
        ("", "is not a ROS parameter file"),
        ("- 1", "is not a ROS parameter file"),
        ("glue: {k: 3}", "is not a ROS parameter file"),
        ("/**: {ros__parameters: 5}", "is not a ROS parameter file"),
        ("/**: {ros__parameters: {5: 5}}", "is not a ROS parameter file"),
        ("a: {ros__parameters: {}}\nb: {ros__parameters: {}}", "is not a ROS parameter file"),
        ("/**: {", "cannot be read"),
        ("/**: {ros__parameters: {glue: {k: -1}}}", "glue.k: -1.0 is out of range"),
        ("/**: {ros__parameters: {glue: {q: 1}}}", "glue.q: no such parameter"),
    ],
)
def test_a_bad_file_is_refused_by_its_name_and_fault(
    content: str, cause: str, tmp_path: Path
) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(content)
    with pytest.raises(InputError) as refused:
        load_yaml(path, Config())
    assert str(path) in str(refused.value)
    assert cause in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_file_that_is_missing_or_no_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "params.yaml"
    with pytest.raises(InputError, match=r"params\.yaml: cannot be read"):
        load_yaml(path, Config())
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match=r"params\.yaml: is not a text"):
        load_yaml(path, Config())


def test_an_unknown_preset_is_refused_with_those_there_are() -> None:
    with pytest.raises(InputError, match="preset 'fast': does not exist; use one of live, paper"):
        load_preset("fast")


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("glue.k", ""),
        ("max_update_rate", ""),
        ("frame_id", "it is read once, when the node starts"),
        ("odometry.window", "the stored keyframes were chosen by it"),
        # said once, of the section
        ("features.visual", "the keyframes hold features of one kind"),
        ("features.ratio", "the keyframes hold features of one kind"),
    ],
)
def test_a_declaration_says_whether_and_why_it_is_fixed_while_the_node_runs(
    name: str, reason: str
) -> None:
    (declared,) = (p for p in ALL if p.name == name)
    assert declared.fixed == reason


@pytest.mark.parametrize(
    ("name", "value", "cause"),
    [
        ("camera_pose", "1 2 3", "is not six or seven finite numbers"),
        ("initial_pose", "0 0 0 0 0 nan", "is not six or seven finite numbers"),
        ("depth_camera_pose", "0 0 0 0 0 0 2", "the quaternion's length is 2, not 1"),
        ("camera_pose", "a b c d e f", "is not a list of numbers"),
        ("odom_frame_id", "", "is not a valid frame name"),
        ("frame_id", "base link", "is not a valid frame name"),
        ("frame_id", "/", "is not a valid frame name"),
        ("frame_id", "base\x1b[2Jlink", "is not a valid frame name"),
        ("frame_id", "/base_link", "begins with a slash"),
        ("camera_pose", "1e300 0 0 0 0 0", "is farther away than 1e\\+07 m"),
        ("initial_pose", "5e7 0 0 0 0 0", "is farther away than 1e\\+07 m"),
    ],
)
def test_a_text_is_checked_where_it_is_set_and_told_what_it_should_be(
    name: str, value: str, cause: str
) -> None:
    (declared,) = (p for p in ALL if p.name == name)
    with pytest.raises(InputError, match=cause) as refused:
        with_values(NodeConfig(), {name: value})
    assert refused.value.remedy == f"give {declared.allowed}"


@pytest.mark.parametrize(
    ("config", "changes", "fault"),
    [
        (Config(), {"camera.depth_min": 9.0}, "camera.depth_min: 9 is not below"),
        (Config(), {"camera.depth_max": 0.1}, "camera.depth_min: 0.1 is not below"),
        (NodeConfig(), {"frame_id": "odom"}, "frame_id: is 'odom', as odom_frame_id is"),
        (NodeConfig(), {"guess_frame_id": "odom"}, "guess_frame_id: is 'odom', as odom_frame_id"),
        (NodeConfig(), {"frame_id": "a", "guess_frame_id": "a"}, "guess_frame_id: is 'a', as fram"),
    ],
)
def test_values_that_do_not_fit_together_are_refused(
    config: Config | NodeConfig, changes: dict[str, Value], fault: str
) -> None:
    with pytest.raises(InputError, match=fault):
        with_values(config, changes)


def test_an_alias_stands_for_a_parameter_and_is_none_itself() -> None:
    names = {p.name for p in ALL}
    assert {*OLD_NAMES.values(), *USUAL_NAMES.values()} <= names
    assert not {*OLD_NAMES, *USUAL_NAMES} & names


def test_an_old_name_is_taken_with_a_line_that_names_the_new_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setitem(OLD_NAMES, "paper.k", "glue.k")
    path = tmp_path / "old.yaml"
    path.write_text("/**: {ros__parameters: {paper: {k: 7}}}")
    assert load_yaml(path, Config()).glue.k == 7.0
    assert caplog.messages == ["The parameter paper.k is now called glue.k"]


def test_a_name_of_rtabmap_is_taken_without_a_word(caplog: pytest.LogCaptureFixture) -> None:
    config = with_values(Config(), {"reset_countdown": 3})
    assert config.odometry.reset_countdown == 3
    assert not caplog.messages


@pytest.mark.parametrize("is_alias_first", [False, True])
def test_a_parameter_set_by_both_its_names_is_refused(is_alias_first: bool) -> None:
    names = sorted(["odometry.reset_countdown", "reset_countdown"], reverse=is_alias_first)
    with pytest.raises(InputError, match=r"reset_countdown, which is set too"):
        with_values(Config(), dict.fromkeys(names, 3))


@pytest.mark.parametrize(
    ("visual", "k", "taken"),
    [
        ("orb", 0.0, 5.0),
        ("sift", 0.0, 5.0),
        ("none", 0.0, 5.0),
        ("xfeat", 0.0, 3.0),
        ("superpoint_superglue", 0.0, 3.0),
        ("orb", 3.0, 3.0),
        ("xfeat", 5.0, 5.0),
    ],
)
def test_k_is_the_papers_for_the_feature_unless_it_is_set(
    visual: str, k: float, taken: float
) -> None:
    assert with_values(Config(), {"features.visual": visual, "glue.k": k}).k == taken


def test_the_papers_preset_asks_for_no_more_than_the_paper() -> None:
    config = load_preset("paper")
    assert config.glue.over_chance == 0
    assert config.glue.fallback == "none"
    assert config.refine.iterations == 0


@pytest.mark.parametrize("value", [np.float32(3), np.float64(3), np.int64(3), 3])
def test_a_number_of_numpy_is_a_number(value: object) -> None:
    k = with_values(Config(), {"glue.k": value}).glue.k
    assert (k, type(k)) == (3.0, float)
