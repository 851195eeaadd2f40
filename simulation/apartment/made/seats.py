"""Chairs, office chairs and stools; armchairs are upholstery's."""

from __future__ import annotations

import numpy as np

from edgemap.simulation.apartment.made import chair_backs, chair_legs
from edgemap.simulation.apartment.made.bent import bar, beam, board, filleted, outline, pad, rod, sheet
from edgemap.simulation.apartment.made.chair_backs import Back
from edgemap.simulation.apartment.made.chair_legs import Seat
from edgemap.simulation.apartment.made.cloths import leather, upholstery, woven
from edgemap.simulation.apartment.made.shapes import BLACK, joined, metal, plastic, tube, wood
from edgemap.simulation.apartment.made.shells import shell
from edgemap.simulation.render.mesh import Material, Mesh

_LEGS = ("square", "square", "tapered", "tapered", "round", "dowel", "turned", "sabre")


def chair(rng: np.random.Generator) -> Mesh:
    """A chair to sit at a table on, in one of eight builds."""
    builds = (
        _joiners,
        _joiners,
        _joiners,
        _windsor,
        _bentwood,
        _parsons,
        _moulded,
        _moulded,
        _steel,
        _folding,
        _garden,
    )
    return joined(builds[int(rng.integers(len(builds)))](rng))


def stool(rng: np.random.Generator) -> Mesh:
    """A stool, mostly for a bar, with or without a low back."""
    tall = rng.random() < 0.7
    top = float(rng.uniform(0.62, 0.8) if tall else rng.uniform(0.42, 0.5))
    wide = float(rng.uniform(0.3, 0.42))
    seat = Seat(wide, wide, wide, top - float(rng.uniform(0.025, 0.07)), top)
    body = wood(rng) if rng.random() < 0.6 else metal(rng)
    square = float(rng.choice([2.0, 2.0, 4.0, 7.0]))
    meshes = _cushioned(rng, seat, square, body)
    low = top * float(rng.uniform(0.25, 0.45))
    if rng.random() < 0.3:
        meshes += chair_legs.pedestal(rng, seat.under, metal(rng), float(rng.uniform(0.19, 0.24)))
        if tall:
            turn = np.linspace(0.0, 2.0 * np.pi, 21)[:, None]
            ring = np.hstack([0.15 * np.cos(turn), 0.15 * np.sin(turn), np.full_like(turn, low)])
            meshes += [rod(ring, 0.009, metal(rng), closed=True), tube((0, 0.15, low), (0, -0.15, low), 0.008, BLACK)]
    else:
        legs = int(rng.choice([3, 4, 4]))
        turns = 2.0 * np.pi * (np.arange(legs) + 0.5) / legs
        reach, out = wide * (0.36 if square < 3 else 0.52), float(rng.uniform(0.0, 0.1)) * (top / 0.7)
        around = np.stack([np.cos(turns), np.sin(turns), 0.0 * turns], axis=1)
        if legs == 3 and square > 3:
            reach *= 0.7
        tops, feet = around * reach + [0, 0, seat.under], around * (reach + out)
        way, radius = str(rng.choice(_LEGS[:6])), float(rng.uniform(0.012, 0.02))
        meshes += [chair_legs.leg(way, a, b, radius, body) for a, b in zip(tops, feet, strict=True)]
        bars = tops + (tops[:, 2:] - low) / tops[:, 2:] * (feet - tops)
        meshes += [
            bar(a, b, radius * 0.6, body, 1.5 * radius) for a, b in zip(bars, np.roll(bars, 1, axis=0), strict=True)
        ]
    if rng.random() < 0.35:
        high = top + float(rng.uniform(0.15, 0.35))
        back = Back(-wide * 0.42, top - 0.03, high, wide * 0.8, wide * 0.9, float(rng.uniform(0.05, 0.2)), 0.05)
        if rng.random() < 0.5:
            meshes += chair_backs.hoop(rng, back, body, 0.01, str(rng.choice(["spindles", "hoop", "board"])))
        else:
            meshes += back.posts(0.012, body, round_=True)
            meshes.append(back.strip(1.05, np.linspace(0.5, 1.0, 4), 0.02, body))
    return joined(meshes)


def office_chair(rng: np.random.Generator) -> Mesh:
    """A swivel chair: star foot, mostly on castors, gas lift, padded or netted back, with or without arms."""
    top = float(rng.uniform(0.42, 0.54))
    seat = _seat(rng, top, (0.42, 0.54), 0.05)
    frame = BLACK if rng.random() < 0.6 else metal(rng)
    cover = upholstery(rng) if rng.random() < 0.6 else leather(rng)
    meshes = chair_legs.star(rng, seat.under, frame, castors=rng.random() < 0.85)
    executive = rng.random() < 0.35
    high = top + float(rng.uniform(0.6, 0.78) if executive else rng.uniform(0.32, 0.6))
    if rng.random() < 0.15:
        meshes.append(shell(rng, seat, min(high, top + 0.5), plastic(rng), 0.015, float(rng.uniform(0.0, 0.12))))
        return joined(meshes)
    meshes.append(beam((-0.12, 0, seat.under - 0.02), (0.12, 0, seat.under - 0.02), (0.16, 0.04), BLACK))
    shape = outline(seat.depth, seat.front, seat.back, float(rng.uniform(3.0, 6.0)))
    meshes.append(pad(shape, seat.under, top, cover, 0.02))
    gap = 0.02 if executive else float(rng.uniform(0.04, 0.2))
    wide = seat.back * float(rng.uniform(0.8, 1.0))
    lean = float(rng.uniform(0.08, 0.25))
    back = Back(-seat.depth / 2.0 + 0.01, top + gap, high, wide, wide * float(rng.uniform(0.75, 1.0)), lean, 0.05)
    behind = plastic(rng) if rng.random() < 0.3 else None
    meshes.append(
        chair_backs.upholstered(
            back, 0.1 if executive else float(rng.uniform(0.02, 0.07)), cover, float(rng.uniform(2.5, 8.0)), behind
        )
    )
    if not executive and rng.random() < 0.2:
        rest = Back(back.x - lean * (high - back.low), high + 0.04, high + 0.17, 0.26, 0.24, lean, 0.02)
        meshes += [
            chair_backs.upholstered(rest, 0.05, cover, 4.0),
            tube(back.at(0, 0.8), rest.at(0, 0.5), 0.012, frame),
        ]
    spine = np.array(
        [
            (-0.08, 0.0, seat.under - 0.02),
            (-seat.depth / 2.0 - 0.06, 0.0, seat.under - 0.02),
            back.at(0.0, 0.6) - [0.02, 0, 0],
        ]
    )
    meshes.append(rod(filleted(spine, 0.09), 0.022, frame, 0.6))
    if executive or rng.random() < 0.6:
        y, rest_z = seat.front / 2.0 + 0.04, top + float(rng.uniform(0.17, 0.25))
        loop = rng.random() < 0.5
        for side in (y, -y):
            flat = [(0.0, side * 0.6, seat.under + 0.01), (0.02, side, seat.under + 0.01), (0.02, side, rest_z)]
            if loop:
                flat = [
                    (0.1, side * 0.8, seat.under + 0.01),
                    (0.14, side, rest_z),
                    (-0.14, side, rest_z),
                    (-0.1, side * 0.8, seat.under + 0.01),
                ]
            meshes.append(rod(filleted(flat, 0.06), 0.016, frame, 0.7))
            rest = pad(outline(0.26, 0.07, 0.06), rest_z, rest_z + 0.03, BLACK, 0.005)
            meshes.append(rest.placed(0.0, side, 0.0, 0.0))
    return joined(meshes)


def _seat(rng: np.random.Generator, top: float, widths: tuple[float, float], thickness: float) -> Seat:
    front = float(rng.uniform(*widths))
    back = front * float(rng.uniform(0.8, 1.0))
    return Seat(front * float(rng.uniform(0.9, 1.05)), front, back, top - thickness, top)


def _cushioned(rng: np.random.Generator, seat: Seat, square: float, body: Material) -> list[Mesh]:
    """A board or woven seat, or one with a padding on it."""
    shape = outline(seat.depth, seat.front, seat.back, square)
    if rng.random() < 0.45:
        return [board(shape, seat.under, seat.top, body if rng.random() < 0.75 else woven(rng))]
    split = seat.under + 0.4 * (seat.top - seat.under)
    base = [board(shape * 0.98, seat.under, split, body)]
    return [*base, pad(shape, split, seat.top, upholstery(rng), float(rng.uniform(0.0, 0.025)))]


def _joiners(rng: np.random.Generator) -> list[Mesh]:
    """Straight or bent rear posts up to the back's top, an apron under the seat, arms now and then."""
    seat = _seat(rng, float(rng.uniform(0.43, 0.49)), (0.38, 0.48), float(rng.uniform(0.025, 0.07)))
    timber, radius = wood(rng), float(rng.uniform(0.014, 0.024))
    way = str(rng.choice(_LEGS))
    high = float(rng.uniform(0.76, 1.1))
    lean = float(rng.uniform(0.05, 0.25))
    flare = seat.back - 2.0 * radius
    back = Back(
        0.01 - seat.depth / 2.0 + radius,
        seat.top - 0.03,
        high,
        flare,
        flare * float(rng.uniform(0.9, 1.08)),
        lean,
        float(rng.choice([0.0, rng.uniform(0.01, 0.05)])),
    )
    meshes = back.posts(radius, timber, round_=way in ("round", "dowel", "turned"))
    meshes += chair_backs.rails(rng, back, timber, upholstery(rng))
    meshes += chair_legs.four_legs(
        rng, seat, way, float(rng.choice([0.0, 0.0, rng.uniform(0.01, 0.06)])), radius, timber
    )
    meshes += _cushioned(rng, seat, float(rng.uniform(6.0, 12.0)), timber)
    if way in ("square", "tapered", "turned", "sabre"):
        tall = np.array([0.0, 0.0, float(rng.uniform(0.03, 0.07)) / 2.0])
        a, b, c, d = seat.corners(radius + 0.008) - tall
        for start, end in ((a, b), (b, d), (d, c), (c, a)):
            let_in = (end - start) * 1.1 * radius / float(np.linalg.norm(end - start))
            meshes.append(beam(start + let_in, end - let_in, (2.0 * tall[2], 0.018), timber, across=(0, 0, 1)))
    if rng.random() < 0.2:
        meshes += _arms(rng, seat, back, radius, timber)
    return meshes


def _arms(rng: np.random.Generator, seat: Seat, back: Back, radius: float, material: Material) -> list[Mesh]:
    """Rests from the back to props in front."""
    rest = seat.top + float(rng.uniform(0.19, 0.26))
    up = (rest - back.low) / (back.high - back.low)
    meshes, reach = [], seat.depth * float(rng.uniform(0.15, 0.42))
    for side in (1.0, -1.0):
        foot = np.array([reach, side * (seat.front / 2.0 - radius), seat.under])
        top = np.array([reach, side * (seat.front / 2.0 + 0.02), rest])
        path = np.array([back.at(side, up), (back.at(side, up) + top) / 2.0 + [0.0, 0.025 * side, 0.012], top])
        path = np.concatenate([path, [top + [0.05, 0.0, -0.008]]])
        meshes += [rod(filleted(path, 0.12), 0.024, material, 0.5), bar(foot, top, radius * 0.8, material, 0.03)]
    return meshes


def _windsor(rng: np.random.Generator) -> list[Mesh]:
    """A thick saddle seat with splayed turned legs and a hoop or comb of spindles let into it."""
    seat = _seat(rng, float(rng.uniform(0.43, 0.47)), (0.4, 0.48), 0.04)
    timber = wood(rng)
    high, bow = float(rng.uniform(0.8, 1.05)), float(rng.uniform(0.03, 0.08))
    wide = seat.back * float(rng.uniform(0.8, 0.9))
    back = Back(-seat.depth / 2.0 + bow + 0.03, seat.top, high, wide, wide * float(rng.uniform(1.0, 1.1)), 0.22, bow)
    meshes = [
        board(outline(seat.depth, seat.front, seat.back, float(rng.uniform(2.6, 4.0))), seat.under, seat.top, timber)
    ]
    meshes += chair_legs.four_legs(
        rng,
        Seat(seat.depth * 0.8, seat.front * 0.8, seat.back * 0.8, seat.under, seat.top),
        str(rng.choice(["turned", "turned", "dowel"])),
        float(rng.uniform(0.04, 0.09)),
        float(rng.uniform(0.015, 0.02)),
        timber,
    )
    if rng.random() < 0.6:
        meshes += chair_backs.hoop(rng, back, timber, 0.012, "spindles")
    else:
        tall = back.high - back.low
        meshes.append(back.strip(1.08, np.linspace(1.0 - 0.09 / tall, 1.0, 3), 0.02, timber))
        for at in np.linspace(-1.0, 1.0, int(rng.integers(5, 9))):
            thick = 0.011 if abs(at) == 1.0 else 0.007
            meshes.append(bar(back.at(at * 0.92, -0.03), back.at(at, 0.97), thick, timber, 0.04))
    if rng.random() < 0.25:
        meshes += _arms(rng, seat, back, 0.014, timber)
    return meshes


def _bentwood(rng: np.random.Generator) -> list[Mesh]:
    """A round seat on bent round legs with a ring between them, and a hoop for a back."""
    wide, top = float(rng.uniform(0.38, 0.43)), float(rng.uniform(0.44, 0.47))
    timber, radius = wood(rng), float(rng.uniform(0.012, 0.016))
    seat = Seat(wide, wide, wide, top - 0.035, top)
    back = Back(-wide * 0.36, top - 0.03, float(rng.uniform(0.82, 0.95)), wide * 0.78, wide * 0.92, 0.18, 0.06)
    shape = outline(wide, wide, wide, 2.0)
    meshes = [board(shape, seat.under, top - 0.008, timber)]
    meshes.append(board(shape * 0.88, top - 0.01, top, woven(rng) if rng.random() < 0.5 else timber))
    tops = np.array([[x, y, seat.under] for x in (0.27, -0.3) for y in (0.27, -0.27)]) * [wide, wide, 1.0]
    out = float(rng.uniform(0.02, 0.05))
    for at in tops:
        foot = at + [np.sign(at[0]) * out, np.sign(at[1]) * out, -at[2]]
        knee = at + [np.sign(at[0]) * out * 0.1, np.sign(at[1]) * out * 0.1, -0.5 * at[2]]
        meshes.append(rod(filleted([at, knee, foot], 0.2), radius, timber))
    turn = np.linspace(0.0, 2.0 * np.pi, 25)
    ring = np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=1) * wide * 0.4
    if rng.random() < 0.7:
        meshes.append(rod(ring + [0, 0, float(rng.uniform(0.16, 0.26))], radius * 0.7, timber, closed=True))
    filling = str(rng.choice(["hoop", "hoop", "spindles", "board", "cane"]))
    meshes += chair_backs.hoop(rng, back, timber, radius, filling)
    if rng.random() < 0.2:
        meshes += _arms(rng, Seat(wide * 0.8, wide * 0.9, wide, seat.under, top), back, radius, timber)
    return meshes


def _parsons(rng: np.random.Generator) -> list[Mesh]:
    """Upholstered all over, on four short-seeming legs of wood or steel."""
    seat = _seat(rng, float(rng.uniform(0.45, 0.5)), (0.42, 0.52), float(rng.uniform(0.07, 0.13)))
    cover = upholstery(rng)
    high, lean = float(rng.uniform(0.8, 1.08)), float(rng.uniform(0.05, 0.2))
    top = seat.back * float(rng.uniform(0.9, 1.05))
    back = Back(-seat.depth / 2.0 + 0.04, seat.under + 0.02, high, seat.back, top, lean, float(rng.uniform(0.0, 0.05)))
    meshes = [
        pad(outline(seat.depth, seat.front, seat.back, float(rng.uniform(4.0, 9.0))), seat.under, seat.top, cover, 0.02)
    ]
    meshes.append(
        chair_backs.upholstered(back, float(rng.uniform(0.05, 0.09)), cover, float(rng.choice([3.0, 6.0, 14.0])))
    )
    way = str(rng.choice(["square", "tapered", "dowel", "sabre", "turned"]))
    legs = wood(rng) if rng.random() < 0.75 else metal(rng)
    splay, radius = float(rng.choice([0.0, rng.uniform(0.01, 0.05)])), float(rng.uniform(0.013, 0.022))
    meshes += chair_legs.four_legs(rng, seat, way, splay, radius, legs)
    return meshes


def _moulded(rng: np.random.Generator) -> list[Mesh]:
    """A shell of plastic, plywood or padding on any foot."""
    seat = _seat(rng, float(rng.uniform(0.43, 0.47)), (0.42, 0.5), 0.03)
    soft = rng.random() < 0.25
    cover = (
        upholstery(rng)
        if soft
        else wood(rng)
        if rng.random() < 0.2
        else woven(rng)
        if rng.random() < 0.1
        else plastic(rng)
    )
    wings = float(rng.choice([0.0, 0.02, rng.uniform(0.05, 0.2)]))
    seat = Seat(seat.depth, seat.front + wings * 0.6, seat.back + wings * 0.6, seat.under, seat.top)
    meshes = [shell(rng, seat, float(rng.uniform(0.74, 0.88)), cover, 0.035 if soft else 0.012, wings)]
    under = Seat(seat.depth * 0.75, seat.front * 0.72, seat.back * 0.72, seat.under + 0.008, seat.top)
    foot, steel = rng.random(), metal(rng)
    if foot < 0.4:
        way = str(rng.choice(["dowel", "dowel", "tapered", "round"]))
        splay = float(rng.uniform(0.03, 0.1))
        timber = wood(rng) if rng.random() < 0.7 else steel
        meshes += chair_legs.four_legs(rng, under, way, splay, 0.014, timber)
        a, b, c, d = under.corners(0.02)
        meshes += [beam(a, d, (0.03, 0.012), steel), beam(b, c, (0.03, 0.012), steel)]
    elif foot < 0.75:
        meshes += chair_legs.tubular(rng, under, steel)
    elif foot < 0.9:
        meshes += chair_legs.pedestal(rng, under.under + 0.01, steel if rng.random() < 0.5 else cover, 0.24)
    else:
        meshes += chair_legs.star(rng, under.under + 0.01, steel, castors=False)
    return meshes


def _steel(rng: np.random.Generator) -> list[Mesh]:
    """Bent tube under a padded or plain seat, with a back between two tubes."""
    seat = _seat(rng, float(rng.uniform(0.43, 0.48)), (0.4, 0.48), float(rng.uniform(0.02, 0.06)))
    steel, radius = metal(rng), float(rng.uniform(0.009, 0.013))
    cover = upholstery(rng) if rng.random() < 0.6 else wood(rng) if rng.random() < 0.5 else plastic(rng)
    meshes = chair_legs.tubular(rng, seat, steel)
    shape = outline(seat.depth, seat.front, seat.back, float(rng.uniform(4.0, 8.0)))
    meshes.append(pad(shape, seat.under, seat.top, cover, float(rng.uniform(0.0, 0.02))))
    high, lean = float(rng.uniform(0.76, 0.95)), float(rng.uniform(0.1, 0.25))
    wide = seat.back - 2.0 * radius
    back = Back(-seat.depth / 2.0 + 0.03, seat.under, high, wide, wide * 0.97, lean, float(rng.uniform(0.0, 0.05)))
    low = float(rng.uniform(0.3, 0.65))
    if rng.random() < 0.5:
        path = [
            back.at(-1, 0) + [0.1, 0, -0.01],
            back.at(-1, 0),
            back.at(-1, 1),
            back.at(1, 1),
            back.at(1, 0),
            back.at(1, 0) + [0.1, 0, -0.01],
        ]
        meshes.append(rod(filleted(path, 0.06), radius, steel))
        up = np.linspace(low, 0.97, 7)
    else:
        for side in (-1, 1):
            path = [back.at(side, 0) + [0.1, 0, -0.01], back.at(side, 0), back.at(side, 0.95)]
            meshes.append(rod(filleted(path, 0.06), radius, steel))
        up = np.linspace(low, 1.0, 7)
    meshes.append(back.strip(1.0, up, float(rng.choice([0.012, 0.03])), cover))
    if rng.random() < 0.2:
        meshes += _arms(rng, seat, back, radius, steel)
    return meshes


def _folding(rng: np.random.Generator) -> list[Mesh]:
    """Two frames crossed at the sides: one up to the back, the other under the seat's rear."""
    wide, top = float(rng.uniform(0.38, 0.44)), float(rng.uniform(0.43, 0.47))
    body = wood(rng) if rng.random() < 0.5 else metal(rng)
    thick = 0.018 if rng.random() < 0.5 else 0.012
    depth, high = float(rng.uniform(0.38, 0.44)), float(rng.uniform(0.76, 0.88))
    foot_x = 0.24
    slope = (foot_x + depth / 2.0 + 0.06) / high
    back = Back(foot_x, 0.0, high, wide, wide, slope, 0.0)
    meshes: list[Mesh] = []
    for side in (1.0, -1.0):
        y = side * wide / 2.0
        meshes.append(beam(back.at(side, 0.0), back.at(side, 1.0), (thick, 1.8 * thick), body))
        inner = y - side * thick * 1.2
        meshes.append(beam((-0.26, inner, 0.0), (depth / 2.0 - 0.03, inner, top - 0.02), (thick, 1.8 * thick), body))
    for x, z, y in ((-0.22, 0.07, wide / 2 - 0.02), (foot_x - slope * 0.1, 0.1, wide / 2)):
        meshes.append(tube((x, y, z), (x, -y, z), 0.008, body))
    seat_mid = 0.02
    if rng.random() < 0.5:
        count = int(rng.integers(4, 8))
        for x in np.linspace(-depth / 2.0, depth / 2.0, count) * 0.9 + seat_mid:
            meshes.append(
                beam(
                    (x, wide / 2, top - 0.008),
                    (x, -wide / 2, top - 0.008),
                    (depth / count * 0.75, 0.015),
                    body,
                    across=(1, 0, 0),
                )
            )
        bars = int(rng.integers(1, 4))
        for at in np.linspace(0.97 - 0.075 * bars, 0.97, bars + 1)[1:]:
            meshes.append(back.strip(1.0, [at - 0.06, at], 0.012, body))
    else:
        cover = plastic(rng) if rng.random() < 0.5 else upholstery(rng)
        meshes.append(
            pad(outline(depth, wide, wide, 7.0), top - 0.03, top, cover, 0.008).placed(seat_mid, 0.0, 0.0, 0.0)
        )
        meshes.append(back.strip(1.0, np.linspace(float(rng.uniform(0.72, 0.85)), 0.99, 4), 0.02, cover))
    return meshes


def _garden(rng: np.random.Generator) -> list[Mesh]:
    """One moulding of plastic: slatted back, arms and broad legs."""
    seat = _seat(rng, float(rng.uniform(0.4, 0.45)), (0.44, 0.5), 0.03)
    body = plastic(rng)
    back = Back(
        -seat.depth / 2.0 + 0.02, seat.under, float(rng.uniform(0.76, 0.95)), seat.back, seat.back * 0.95, 0.22, 0.06
    )
    meshes = [board(outline(seat.depth, seat.front, seat.back, 7.0), seat.under, seat.top, body)]
    tops = seat.corners(0.03)
    for top in tops:
        foot = top + [np.sign(top[0]) * 0.04, np.sign(top[1]) * 0.05, -top[2]]
        meshes.append(beam(top + [0, np.sign(top[1]) * 0.01, 0.0], foot, (0.055, 0.045), body, 0.75))
    meshes += chair_backs.hoop(rng, back, body, 0.02, str(rng.choice(["board", "spindles"])))
    if rng.random() < 0.4:
        for at in np.linspace(-0.6, 0.6, 5):
            edges = at + np.array([-0.09, 0.09])
            meshes.append(sheet(back.at(edges, np.array([[0.0], [0.8]])), 0.012, body))
    if rng.random() < 0.75:
        meshes += _arms(rng, seat, back, 0.024, body)
    return meshes
