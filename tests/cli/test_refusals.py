"""Every command's refusals in one table: exit code, and a fragment with the number or the name; nothing is written."""

import json
import os
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np
import pytest
from support import painted
from support.pictures import write_scene
from support.rooms import mapped

from edgemap.cli import main
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.inputs.drives import write_drive
from edgemap.runtime.inputs.drives.camera_yaml import CameraFile, write_camera_yaml
from edgemap.runtime.step.map_file import save_map

LONG, NINES = "a" * 5000, "9" * 5000
USAGE = [  # tyro's own errors in one line that names the help
    ("run --frames many", "--frames: expected INT, not 'many'"),
    ("run --frames", "--frames"),
    ("run --no-such-flag", "--no-such-flag"),
    ("run --odometri gyro", "did you mean --odometry?"),
    ("run extra", "extra"),
    ("run drive.mp4", "did you mean --camera drive.mp4?"),
    ("run pictures", "did you mean --camera pictures?"),
    ("run 0", "did you mean --camera 0?"),
    ("doctor pictures/", "did you mean --camera pictures/?"),
    ("pull yolov3 a/b", "a/b"),
    ("run --precision int4", "int4"),
    ("run --engine auto", "auto"),
    ("run --confidence high", "--confidence"),
    ("map export x", "--format"),
    ("map export x --format pdf", "pdf"),
    ("map merge a", "--out"),
    ("eval detection", "--data"),
    ("bench --rate fast", "--rate"),
    ("pull", "NAME|URL|FOLDER"),
    ("simulate --seed x -o y", "--seed"),
]
RUN = "run --camera pictures --bundle bundle --out out"
SCALE = "map scale run -o out"
DETECTOR = "train detector --data yolo:carpets --validation yolo:carpets -o out"
ODOMETRY = "train odometry --data drive:carpets --validation drive:carpets --backbone edgemap-nano -o out"
FLOOR = "train floor --validation floor:carpets -o out"
TEACHER = "not a TensorFlow Lite file" if find_spec("ai_edge_litert") else "--teacher needs ai-edge-litert"
REFUSED = [
    ("rnu", 2, "'run'"),
    ("map shw", 2, "'map show'"),
    ("mapp", 2, "'map'"),
    ("\udcff1", 2, "there are: bench"),
    ("eval odometri", 2, "'eval odometry'"),
    (f"{RUN} --intrinsics nan,50,32,32", 2, "finite"),
    (f"{RUN} --intrinsics=-50,50,32,32", 2, "-50.0"),
    (f"{RUN} --intrinsics 50,50", 2, "4 numbers"),
    (f"{RUN} --intrinsics 32,32,500,500", 2, "500,500"),
    (f"{RUN} --mount 1.0,-60", 2, "sky"),
    (f"{RUN} --mount=-1,0", 2, "-1.0 m"),
    (f"{RUN} --mount high", 2, "HEIGHT_M"),
    (f"{RUN} --mount 0.6,11,5", 2, "2 numbers"),
    (f"{RUN} --mount 60", 2, "60 m"),
    (f"{RUN} --mount 11.5,0.6", 2, "0.05 to 3 m"),
    (f"{RUN} --mount nan", 2, "finite"),
    (f"{RUN} --frames 0", 2, "0: must be 1 or more"),
    (f"{RUN} --threads 0", 2, "0: must be 1 or more"),
    (f"{RUN} --threads 65", 2, "at most 64"),
    (f"{RUN} --rate 0", 2, "--rate 0"),
    (f"{RUN} --rate nan", 2, "--rate nan"),
    (f"{RUN} --confidence 2", 2, "--confidence 2:"),
    (f"{RUN} --confidence nan", 2, "nan"),
    (f"{RUN} --odometry magic", 2, "'magic'"),
    (f"{RUN} --odometry planar", 2, "'planar'"),
    (f"{RUN} --odometry wheels", 2, "wheel:FILE.csv?"),
    (f"{RUN} --odometry paper", 1, "no paper odometry"),
    (f"{RUN} --odometry truth", 1, "odometry truth: pictures"),
    (f"{RUN} --odometry none.tum", 1, "none.tum"),
    (f"{RUN} --odometry wheel:none.csv", 1, "none.csv"),
    (f"{RUN} --classes chairs", 2, "did you mean chair?"),
    (f"{RUN} --classes unicorn", 2, "chair, couch, person"),
    (f"{RUN} --topics wheel=/odom", 2, "wheel=/odom"),
    (f"{RUN} --precision int8", 1, "int8"),
    (f"{RUN} --map nowhere.json", 1, "nowhere.json"),
    (f"{RUN} --start 0,0,0", 2, "--map"),
    ([*RUN.split(), "--map", ""], 1, "name is empty"),
    (f"{RUN} --map room.json --start 0,0", 2, "3 numbers"),
    (f"{RUN} --map room.json --clustering paper", 2, "association"),
    (f"{RUN} --record there.mcap", 2, "there.mcap"),
    (f"{RUN} --record a.bag", 2, ".mcap"),
    (f"{RUN} --config room.json", 1, "room.json"),
    (f"{RUN} --config-options", 2, "--config FILE"),
    ("run --camera pictures --bundle edgemap-nanno", 2, "edgemap-nano?"),
    ("run --camera pictures --bundle nonsense", 2, "edgemap-nano, edgemap-pico"),
    ("run --camera no/such/thing", 1, "realsense"),
    ("run --camera empty --bundle bundle", 1, "images"),
    ("run --camera sim:" + NINES, 2, "sim:SEED"),
    ("run --camera rtsp://[ --bundle bundle", 1, "no stream that FFmpeg reads"),
    ("run --camera ~nobody-here/x", 1, "no such file"),
    ("run --camera drive:~nobody-here/x", 1, "no such folder"),
    ("bench --camera sim:kitchen --bundle bundle", 2, "'sim:kitchen'"),
    ("record --camera pictures -o there.mcap", 2, "there.mcap"),
    ("record --camera pictures -o a.bag", 2, ".mcap"),
    (f"run --camera {LONG}", 1, "File name too long"),
    (f"run --bundle {LONG}", 1, "File name too long"),
    (f"run --config {LONG}", 1, "File name too long"),
    (f"map show {LONG}", 1, "File name too long"),
    (f"pull {LONG}", 1, "File name too long"),
    ("run --bundle net.onnx --out out", 1, "net.onnx"),
    ("pull ~nobody-here", 1, "neither"),
    (["map", "show", "a\x1b[2Jb"], 1, "a [2Jb"),
    (["run", "--camera", "a\nb\x1b[2J/c.mp4"], 1, r"'a\nb\x1b[2J/c.mp4'"),
    (["run", "--camera", "kitti:a\r\n\u202eb"], 1, r"a\r\n\u202eb"),
    (["map", "show", "a\nb\udcff"], 1, "cannot be read"),
    (["map", "export", "a\nb", "--format", "csv"], 1, "cannot be read"),
    (["pull", "a\nb"], 1, r"a\nb"),
    (["run", "--camera", "~root\0"], 1, r"~root\x00"),
    (["run", "--bundle", "~\0x"], 2, r"~\x00x"),
    (["map", "show", "~\0"], 1, "null byte"),
    ("detect pictures/0.png --bundle bundle --precision int8", 1, "int8"),
    ("detect pictures/0.png --bundle bundle --names carpets/poses.tum", 1, "have names already"),
    ("why empty", 1, "empty"),
    ("why none", 1, "none"),
    ("map show room.json --label chairs", 2, "did you mean chair?"),
    ("map show room.json --near 1", 2, "2 numbers"),
    ("map show room.json --near nan,1", 2, "finite"),
    ("map show room.json --inside 0,0;1,1", 2, "three corners"),
    ("map show room.json --inside 0,0;1,1;x,2", 2, "'x,2'"),
    ("map show room.json --label ,", 2, "empty"),
    ("map show room.json room.json --json", 2, "one map"),
    ("map show room.json --out map.foo", 1, ".png or .svg"),
    ("map show room.json --out net.onnx/map.png", 4, "net.onnx"),
    ("map approach room.json", 2, "--label"),
    ("map approach room.json chair-1 --label chair", 2, "--label"),
    ("map approach room.json chair-7", 2, "did you mean chair-2?"),
    ("map approach room.json --label bed", 2, "chair, couch"),
    ("map approach room.json chair-1 --standoff 0", 2, "--standoff 0"),
    ("map approach room.json chair-1 --near 1", 2, "2 numbers"),
    ("map export room.json --format csv -o room.json", 2, "map itself"),
    ("map export room.json --format png -o x.svg", 2, ".png"),
    ("map export room.json --format nav2 --resolution 0", 2, "--resolution 0:"),
    ("map export room.json --format nav2 --keep-out hall", 2, "nav2-masks and nav2-vector"),
    ("map export room.json --format csv --speed hall=50", 2, "--speed is for --format nav2-masks"),
    ("map merge room.json -o out.json", 2, "two"),
    ("map merge run room.json -o run", 2, "holds a run"),
    (f"{SCALE}", 2, "one length"),
    (f"{SCALE} --height 0.6 --between a,b,1", 2, "one length"),
    (f"{SCALE} --height 2.4", 2, "3.2 times"),
    (f"{SCALE} --height 0.01", 2, "0.05 to 3 m"),
    (f"{SCALE} --between chair-1,bed-1,2", 2, "'bed-1'"),
    (f"{SCALE} --between chair-1,2", 2, "ID,ID,METRES"),
    (f"{SCALE} --between chair-1,couch-1,-2", 2, "ID,ID,METRES"),
    (f"{SCALE} --between chair-1,chair-1,2", 2, "0.00 m"),
    ("map scale run -o run --height 0.6", 2, "folder of its own"),
    ("map scale run -o run --between chair-1,couch-1,3", 2, "folder of its own"),
    ("calibrate intrinsics --camera demo --board " + NINES + "x6", 2, "COLSxROWS"),
    ("calibrate intrinsics --camera pictures --board nine", 2, "COLSxROWS"),
    ("calibrate intrinsics --camera plain -o out.yaml", 1, "need 8"),
    ("calibrate mount --camera plain --square 0.06 --camera-file lens.yaml -o out.yaml", 1, "0 different views"),
    ("calibrate mount --camera plain --square 0.06 -o out.yaml", 2, "--intrinsics"),
    ("calibrate mount --camera plain --camera-file lens.yaml -o out.yaml", 2, "neither depth nor wheels"),
    ("calibrate mount --camera plain --camera-file lens.yaml --height 1 -o out.yaml", 1, "0 pictures"),
    ("calibrate tilt --camera plain --camera-file lens.yaml -o out.yaml", 2, "height"),
    ("calibrate tilt --camera plain --camera-file lens.yaml --height 1 -o out.yaml", 1, "0 pictures"),
    ("calibrate mount --camera plain --camera-file lens.yaml --height 0 -o out.yaml", 2, "--height 0:"),
    ("calibrate tilt --camera plain --camera-file lens.yaml --height 0 -o out.yaml", 2, "--height 0:"),
    ("calibrate tilt --camera demo -o lens.yaml", 2, "exists"),
    ("simulate --frames 0 -o out", 2, "--frames 0"),
    ("simulate --seed -3 -o out", 2, "--seed -3"),
    ("simulate --pictures 4 -o out", 2, "A:B"),
    ("simulate --pictures 4 --seeds 9:2 -o out", 2, "'9:2'"),
    ("simulate --seeds 0:9 --shard 0/3 -o out", 2, "'0/3'"),
    ("simulate --seeds 0:2 --shard 3/3 -o out", 2, "3/3"),
    ("simulate --mount high -o out", 2, "'high'"),
    ("simulate --carried -o out", 2, "--carried is for --pictures"),
    ("eval map --camera sim:-1 --bundle bundle", 2, "'sim:-1'"),
    ("eval map --camera tum:pictures --bundle bundle", 1, "pictures"),
    ("eval floor --data kitti:pictures", 2, "floor:DIR"),
    ("eval odometry --data demo --segments 1,-2", 2, "metres"),
    ("eval odometry --data demo --from -1", 2, "--from -1"),
    ("eval odometry --data demo --data demo", 2, "twice"),
    ("eval odometry --data demo --from 600", 1, "two"),
    ("eval odometry --data demo --mount 60,11", 2, "60 m"),
    (f"{DETECTOR} --minutes 0", 2, "--minutes 0"),
    (f"{DETECTOR} --input 100", 2, "multiple of 32"),
    (f"{DETECTOR} --mix 1 2", 2, "1 shares"),
    (f"{DETECTOR} --bundle resnet", 1, "no such folder"),
    (f"{DETECTOR} --start none.pt", 1, "none.pt: no such checkpoint"),
    (f"{DETECTOR} --weights none.pt", 1, "none.pt: no such checkpoint"),
    (f"{DETECTOR} --keep edgemap-nano", 2, "edgemap-nano: knows 18 other classes than yolox-nano with 80"),
    (f"{DETECTOR} --device cuda", 1, "--device cuda: torch finds no GPU here"),
    (f"{ODOMETRY} --steps -1", 2, "--steps -1"),
    (f"{ODOMETRY} --length 1", 2, "--length 1"),
    (f"{ODOMETRY} --rate -1", 2, "--rate -1"),
    (f"{ODOMETRY} --head flow", 2, "--head flow: the only learned odometry is paper"),
    (f"{ODOMETRY} --feature nose", 1, "no tensor 'nose'"),
    (f"{ODOMETRY} --frames 1", 1, "4 pictures, wanted are those from 0 to 1"),
    (f"{FLOOR} --data plain", 1, "need a --teacher"),
    (f"{FLOOR} --data plain --teacher net.onnx", 1, TEACHER),
    (f"{FLOOR} --data floor:carpets --mix 0.5 0.5", 2, "--mix 0.5 0.5: expected 1 shares"),
    ("eval floor --data floor:empty", 1, "no floor labels NAME.png for 1 pictures"),
    ("eval floor --data floor:carpets --bundle yolox-nano", 2, "has no floor head"),
    ("eval floor --data floor:small", 1, "8x4 px, its picture has 640x480"),
    ("eval floor --data floor:sevens", 1, "holds 7, expected 1 floor"),
    ("export --backbone yolov3-tiny --random-weights --int8 -o out", 2, "--calibrate"),
    ("export --backbone yolov3-tiny --random-weights --calibrate empty -o out", 2, "--int8"),
    ("export --backbone yolov3-tiny --random-weights --int8 --calibrate nowhere -o out", 1, "nowhere"),
]


@pytest.fixture(scope="module")
def world(tmp_path_factory) -> Path:
    """What the rows name: pictures with a lens, a bundle, maps, a run, and files that are none."""
    folder = tmp_path_factory.mktemp("world")
    write_scene(folder)
    painted.write_painted(folder / "bundle", [("chair", 40.0, 30.0, 12.0, 24.0, 0.9)])
    floors = {"carpets": np.ones((480, 640)), "small": np.ones((4, 8)), "sevens": np.full((480, 640), 7)}
    for name in ("plain", "run", "empty/images", *(f"{one}/{part}" for one in floors for part in ("images", "floor"))):
        (folder / name).mkdir(parents=True)
    for index in range(4):
        for name in ("plain", *(f"{one}/images" for one in floors)):
            cv2.imwrite(str(folder / name / f"{index}.png"), np.full((480, 640, 3), 90, np.uint8))
        for name, labels in floors.items():
            cv2.imwrite(str(folder / name / "floor" / f"{index}.png"), labels.astype(np.uint8))
    way, chair = Trajectory(np.arange(4) / 10.0, (SE2(),) * 4), {"id": 1, "label": "chair", "box": [9, 9, 99, 99]}
    lens, boxes = Intrinsics(640, 480, 587.0, 587.0, 319.5, 239.5), [[chair | {"visible": 1.0}]] * 4
    write_drive(folder / "carpets", CameraFile(lens, Mount(0.6), 10.0), way, boxes=boxes)
    for name in ("empty/images/0.png", "net.onnx", "there.mcap"):
        (folder / name).touch()
    write_camera_yaml(folder / "lens.yaml", CameraFile(lens))
    save_map(folder / "room.json", mapped([("chair", 3.0, 0.0), ("chair", -1.0, 0.5), ("couch", 1.0, 1.0)]))
    save_map(folder / "run" / "map.json", mapped([("chair", 1.0, 0.0), ("couch", 3.0, 2.0)]))
    record = {"mount": {"height_m": 0.75}, "odometry": "hybrid", "quality": {"wheel_frames": 0}}
    (folder / "run" / "run.json").write_text(json.dumps(record))
    return folder


def answer(capsys, arguments) -> tuple[int, str]:
    """Exit code and the last line of standard error; only notices of the bundle and faults of frames precede it."""
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    *notices, line = capsys.readouterr().err.splitlines()
    assert all(notice.startswith(("frame ", "bundle ")) for notice in notices), notices
    assert isinstance(ended.value.code, int)
    return ended.value.code, line


@pytest.mark.parametrize(("command", "fragment"), USAGE, ids=[row[0] for row in USAGE])
def test_wrong_usage_is_one_line_that_names_the_help(world, monkeypatch, capsys, command, fragment):
    monkeypatch.chdir(world)
    code, line = answer(capsys, command.split())
    assert code == 2
    assert fragment in line
    assert line.endswith("--help)")
    assert "│" not in line


@pytest.mark.parametrize(("command", "code", "fragment"), REFUSED, ids=[str(row[0])[:60] for row in REFUSED])
def test_what_cannot_be_done_is_one_line_and_writes_nothing(world, monkeypatch, capsys, command, code, fragment):
    monkeypatch.chdir(world)
    monkeypatch.setenv("EDGEMAP_CACHE", str(world / "none"))
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "")
    before = sorted(os.walk(world))
    ended, line = answer(capsys, command if isinstance(command, list) else command.split())
    assert fragment in line
    assert ended == code
    assert line.isprintable()
    assert sorted(os.walk(world)) == before
