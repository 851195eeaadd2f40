"""The layer plans of YOLOv3 and YOLOv3-tiny (Redmon and Farhadi 2018), written out as Darknet cfg text."""

TINY_ANCHORS = "10,14, 23,27, 37,58, 81,82, 135,169, 344,319"
FULL_ANCHORS = "10,13, 16,30, 33,23, 30,61, 62,45, 59,119, 116,90, 156,198, 373,326"
CLASSES = 80


def _section(kind: str, **options: object) -> str:
    return f"[{kind}]\n" + "".join(f"{key.rstrip('_')}={value}\n" for key, value in options.items())


def _net(size: int) -> str:
    return _section("net", width=size, height=size, channels=3)


def _conv(filters: int, size: int, stride: int = 1) -> str:
    return _section(
        "convolutional", batch_normalize=1, filters=filters, size=size, stride=stride, pad=1, activation="leaky"
    )


def _head(mask: str, anchors: str) -> str:
    filters = 3 * (CLASSES + 5)
    conv = _section("convolutional", size=1, stride=1, pad=1, filters=filters, activation="linear")
    return conv + _section("yolo", mask=mask, anchors=anchors, classes=CLASSES, num=anchors.count(",") // 2 + 1)


def _finer(branch: int, join: int, filters: int) -> str:
    """From a branch point to the next finer grid, joined with an earlier layer of that grid."""
    return (
        _section("route", layers=branch)
        + _conv(filters, 1)
        + _section("upsample", stride=2)
        + _section("route", layers=f"-1, {join}")
    )


def yolov3_tiny(size: int = 416) -> str:
    """Cfg text of YOLOv3-tiny: 24 layers, 8,858,734 values, heads of stride 32 and 16."""
    text = _net(size)
    for filters, stride in ((16, 2), (32, 2), (64, 2), (128, 2), (256, 2), (512, 1)):
        text += _conv(filters, 3) + _section("maxpool", size=2, stride=stride)
    text += _conv(1024, 3) + _conv(256, 1) + _conv(512, 3) + _head("3,4,5", TINY_ANCHORS)
    return text + _finer(-4, 8, 128) + _conv(256, 3) + _head("0,1,2", TINY_ANCHORS)


def yolov3(size: int = 416) -> str:
    """Cfg text of YOLOv3: Darknet-53 and three heads, 107 layers, 62,001,757 values, strides 32, 16 and 8."""
    text = _net(size) + _conv(32, 3)
    for filters, blocks in ((64, 1), (128, 2), (256, 8), (512, 8), (1024, 4)):
        residual = _conv(filters // 2, 1) + _conv(filters, 3) + _section("shortcut", from_=-3, activation="linear")
        text += _conv(filters, 3, stride=2) + blocks * residual
    text += 3 * (_conv(512, 1) + _conv(1024, 3)) + _head("6,7,8", FULL_ANCHORS)
    text += _finer(-4, 61, 256) + 3 * (_conv(256, 1) + _conv(512, 3)) + _head("3,4,5", FULL_ANCHORS)
    return text + _finer(-4, 36, 128) + 3 * (_conv(128, 1) + _conv(256, 3)) + _head("0,1,2", FULL_ANCHORS)
