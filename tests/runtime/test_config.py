import itertools
import json
from dataclasses import replace
from pathlib import Path

import jsonschema
import msgspec
import pytest
import yaml
from support.faults import kinds
from support.steps import Steps

import edgemap
from edgemap.bridges.schemas import KINDS, schema, schema_text
from edgemap.geometry.objects.annotations import NO_ANNOTATIONS, MapIdentity
from edgemap.geometry.objects.events import Edit
from edgemap.geometry.objects.zone_watch import ZoneWatch
from edgemap.runtime.outputs.verdict.verdict import verdict_of
from edgemap.runtime.step.config import Config, ConfigError, load_config, load_options
from edgemap.runtime.step.map_file import change_record, map_document, saved_text


def written(folder, document, name="c.yaml"):
    path = folder / name
    path.write_text(json.dumps(document) if name.endswith(".json") else yaml.safe_dump(document))
    return path


def test_a_part_of_the_tree_changes_that_part_alone(tmp_path):
    tree = {"forgetting": {"same_m": 0.5}, "loop_closure": {"keyframes": {"keyframe_m": 0.5}}}
    path = written(tmp_path, {"config": tree})
    config, options = load_config(path), load_options(path)
    assert (config.forgetting.same_m, config.loop_closure.keyframes.keyframe_m, options) == (0.5, 0.5, {})
    assert config.association.min_count == Config().association.min_count
    assert config.floor == Config().floor
    again = load_config(written(tmp_path, {"config": msgspec.to_builtins(config)}, "run.json"))
    assert again == config  # the resolved tree gives itself back


def test_numbers_of_another_version_s_run_are_passed_over_and_printed(tmp_path, capsys):
    pictures = {"gyro_upright_rad": [0.02, 0.04], "least_weight": 9.5}
    document = {"odometry": {"pictures": pictures}, "weather": {"rain": 1}}
    config = load_config(written(tmp_path, {"format": "edgemap.run/1", "config": document}, "run.json"))
    assert config.odometry.pictures.least_weight == 9.5
    printed = capsys.readouterr().err
    assert "2 numbers of another version passed over: odometry.pictures.gyro_upright_rad, weather" in printed
    load_options(tmp_path / "run.json")
    assert capsys.readouterr().err == ""  # printed once for a run, which asks for both
    with pytest.raises(ConfigError, match=r"pictures\.gyro_upright_rad is unknown"):  # a person wrote it
        load_config(written(tmp_path, {"config": document}))
    with pytest.raises(ConfigError, match=r"pictures\.gyro_upright_rad is unknown"):
        load_config(written(tmp_path, {"config": document}, "tuned.json"))


@pytest.mark.parametrize(
    ("document", "told"),
    [
        ({"config": {"asociation": {}}}, r"config\.asociation is unknown \(known: association, "),
        ({"config": {"forgetting": {"same_m": "wide"}}}, r"`\$\.forgetting\.same_m`, found 'wide'"),
        ({"config": {"forgetting": {"same_m": float("inf")}}}, "not a finite number"),
        ({"config": {"forgetting": {"same_m": 1e15}}}, "not a finite number"),
        ({"config": {"association": 3}}, r"`\$\.association`, found 3"),
        ({"config": {"odometry": {"pictures": {"window": {"keyframes": 0}}}}}, "keyframes is 0, must be above 0"),
        ({"config": {"association": {"min_count": -4}}}, "min_count is -4: must not be negative"),
        ({"config": {"floor": {"mapped": ["chair"]}}}, r"floor\.mapped is unknown"),
        ({"options": ["frames"]}, "options is a list, not a mapping"),
        ({"other": 1}, "neither a section"),
        ([1], "neither a section"),
    ],
)
def test_mistakes_are_named(tmp_path, document, told):
    path = written(tmp_path, document)
    with pytest.raises(ConfigError, match=told):
        (load_options if "options" in document else load_config)(path)


def test_what_is_no_file_or_no_document_is_told_in_one_line(tmp_path):
    with pytest.raises(ConfigError, match="cannot be read"):
        load_config(tmp_path / "none.yaml")
    (tmp_path / "deep.json").write_text("[" * 100_000)
    with pytest.raises(ConfigError, match=r"deep\.json"):
        load_config(tmp_path / "deep.json")


SHARP, WEIGHTY = {"health": {"sharp": 9.0}}, {"odometry": {"pictures": {"least_weight": 1e6}}}


@pytest.mark.parametrize(("tree", "kind"), [(SHARP, "blurred"), (WEIGHTY, "odometry")])
def test_the_stages_take_their_parts_of_the_tree(tmp_path, tree, kind):
    config = load_config(written(tmp_path, {"config": {"attitude": {"check": {"tilt": {"nod": 2e-4}}}, **tree}}))
    with edgemap.open("demo", wheels=False, config=config) as session:
        first, second = itertools.islice(session, 2)
    assert kind in kinds((*first.motion.faults, *second.motion.faults))
    assert second.observed.camera.attitude.covariance_rad2[0, 0] <= 1e-4**2


FOLDER = Path(__file__).parents[2] / "docs" / "schema"


@pytest.fixture(scope="module")
def documents():
    """Documents of each kind, as a run makes them."""
    steps, watch = Steps(), ZoneWatch()
    for _ in range(20):
        steps.next()
    steps.mapper.edit(Edit("name", "chair-1", name="mine"))
    steps.mapper.edit(Edit("dock", pose=(0.0, 1.0, 0.5)))
    steps.mapper.edit(Edit("zone", name="hall", corners_m=((2.0, 0.0), (4.0, 0.0), (4.0, 2.0), (2.0, 2.0))))
    objects, annotations = steps.mapper.objects(), steps.mapper.annotations()
    identity = replace(annotations.identity, level="care", reasons=("dim light",))
    annotations = replace(annotations, identity=identity, vanished=(replace(objects[1], id="couch-9"),))
    watch.update([], annotations.zones, 0.0)
    events = [event for stamp_s in (1.0, 3.0) for event in watch.update(objects, annotations.zones, stamp_s)]
    return {
        "map": [map_document(objects, annotations), json.loads(saved_text(map_document(objects, annotations)))],
        "verdict": [verdict_of({}, objects).document()],
        "change": [change_record(item, event) for item in objects for event in item.history],
        "zone-event": [event.record() | {"stamp_s": event.stamp_s} for event in events],
    }


@pytest.mark.parametrize("kind", KINDS)
def test_documents_meet_their_published_schema(documents, kind):
    assert (FOLDER / f"{kind}.json").read_text() == schema_text(kind), "python -m edgemap.bridges.schemas docs/schema"
    assert documents[kind]
    for document in documents[kind]:
        jsonschema.validate(json.loads(json.dumps(document)), schema(kind))


def test_what_no_map_may_hold_fails():
    document = map_document([], replace(NO_ANNOTATIONS, identity=MapIdentity("home", 0)))
    with pytest.raises(jsonschema.ValidationError, match="0 is less than the minimum of 1"):
        jsonschema.validate(document, schema("map"))
