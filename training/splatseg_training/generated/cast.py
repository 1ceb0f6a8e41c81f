"""Ray casting of parts and rooms by closed-form intersections, for batches of scenes.

The image is cut into tiles of 16 × 16 pixels. A part is only intersected with the rays of the tiles that the rectangle
around its projected corners touches: about ten of a scene's hundreds of parts. The walls, floor and ceiling are one box
seen from inside. Lengths are in metres along the camera's z axis, so that they are depths.
"""

from typing import NamedTuple

import torch

from .parts import BALL, BOX, CYLINDER

TILE = 16  # pixels
NEAREST = 0.05  # metres
PARALLEL = 1e-8  # smaller components of a ray count as this, because 0 would give 0 / 0
FACES = 6  # ids of a room: 1 and 2 the walls at -x and +x, 3 and 4 at -y and +y, 5 the floor, 6 the ceiling
TESTS = {"cpu": 1 << 18, "cuda": 1 << 24}  # intersections at a time: what fits a core's cache, or 2 GiB
_NOTHING = (0x7F800000 << 32) | 0xFFFFFFFF  # infinitely far, no part
_CORNERS = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]


class Cameras(NamedTuple):
    """Pinhole cameras, x right, y down, z forward; pixel centres are at integer coordinates."""

    rotation: torch.Tensor  # [B, 3, 3] from camera to world
    position: torch.Tensor  # [B, 3] metres
    intrinsics: torch.Tensor  # [B, 4]: fx, fy, cx, cy in pixels

    def rays(self, height, width):
        """x [B, 1, width] and y [B, height, 1] of the points at z = 1 m."""
        fx, fy, cx, cy = self.intrinsics[:, :, None, None].unbind(1)
        u = torch.arange(width, device=fx.device, dtype=fx.dtype).view(1, 1, -1)
        v = torch.arange(height, device=fx.device, dtype=fx.dtype).view(1, -1, 1)
        return (u - cx) / fx, (v - cy) / fy


class Hits(NamedTuple):
    """What the rays hit, [B, H, W]."""

    z: torch.Tensor  # float32 metres, 0: nothing
    part: torch.Tensor  # int64, index of the part; -1 to -6: a face of the room with ids 1 to 6; -7: nothing
    id: torch.Tensor  # int64, 0: nothing


def cast(parts, cameras, height, width, room=None):
    """`Hits` of the rays of a batch of cameras with parts [B, P], in rooms from `room` = (least, greatest) corner, each
    [B, 3], or in empty space."""
    keys = _nearest(parts, cameras, height, width)
    z = (keys >> 32).int().view(torch.float32)
    part = (keys & 0xFFFFFFFF).where(z.isfinite(), -FACES - 1)
    id = parts.id.gather(1, part.clamp(min=0).flatten(1)).view(part.shape)
    id = id.where(part >= 0, 0)
    if room:
        exit, face = _inside(*room, cameras, height, width)
        nearer = exit < z
        z, part, id = exit.where(nearer, z), (-face).where(nearer, part), face.where(nearer, id)
    return Hits(z.where(id > 0, 0), part, id)


def _nearest(parts, cameras, height, width):
    """For each pixel, the depth's bits above the part's index, int64 [B, H, W], so that the least is the nearest."""
    batch = len(parts.id)
    rows, columns = -(-height // TILE), -(-width // TILE)
    x, y = cameras.rays(rows * TILE, columns * TILE)
    x, y = x.view(batch, columns, TILE), y.view(batch, rows, TILE)
    keys = torch.full((batch * rows * columns, TILE * TILE), _NOTHING, dtype=torch.int64, device=x.device)
    touched = tiles(parts, cameras, height, width)
    origin, linear = _local(parts, cameras)
    limit = max(1, TESTS.get(x.device.type, 1 << 24) // (TILE * TILE))
    for shape in (BOX, CYLINDER, BALL):
        pairs = (touched & (parts.shape == shape)[:, :, None, None]).nonzero()
        for scene, part, row, column in (pair.unbind(1) for pair in pairs.split(limit)):
            near = _entry(shape, origin[scene, part], linear[scene, part], x[scene, column], y[scene, row])
            key = (near.flatten(1).view(torch.int32).long() << 32) | part[:, None]
            tile = (scene * rows + row) * columns + column
            keys.scatter_reduce_(0, tile[:, None].expand_as(key), key, "amin")
    whole = keys.view(batch, rows, columns, TILE, TILE).transpose(2, 3).reshape(batch, rows * TILE, columns * TILE)
    return whole[:, :height, :width]


def tiles(parts, cameras, height, width):
    """Which tiles [B, P, rows, columns] the rectangles around the projected parts touch."""
    signs = torch.tensor(_CORNERS, device=parts.half.device, dtype=torch.float32)
    corners = (signs * parts.half[:, :, None]) @ parts.axes.mT + parts.centre[:, :, None]
    corners = (corners - cameras.position[:, None, None]) @ cameras.rotation[:, None]
    fx, fy, cx, cy = cameras.intrinsics[:, :, None, None].unbind(1)
    forward = corners[..., 2]
    ahead, crossing = forward.amax(2) > NEAREST, forward.amin(2) < NEAREST
    forward = forward.clamp(min=NEAREST)
    u, v = corners[..., 0] / forward * fx + cx, corners[..., 1] / forward * fy + cy
    exists = (parts.id > 0) & ahead
    across = _overlap(u, crossing, -(-width // TILE))
    down = _overlap(v, crossing, -(-height // TILE))
    return exists[:, :, None, None] & down[:, :, :, None] & across[:, :, None, :]


def _overlap(at, crossing, count):
    """Which of `count` tiles [B, P, count] the projected corners [B, P, 8] span; all, if the part crosses z = 0."""
    first = TILE * torch.arange(count, device=at.device, dtype=torch.float32)
    inside = (at.amin(2, keepdim=True) <= first + TILE) & (at.amax(2, keepdim=True) >= first - 1)
    return inside | crossing[:, :, None]


def _local(parts, cameras):
    """The camera [B, P, 3] and its axes [B, P, 3, 3] in the coordinates in which a part is the unit solid."""
    into = parts.axes.mT / parts.half.clamp(min=1e-5)[..., None]
    origin = into @ (cameras.position[:, None] - parts.centre)[..., None]
    return origin[..., 0], into @ cameras.rotation[:, None]


def _entry(shape, origin, linear, x, y):
    """Depth [N, T, T] at which rays enter unit solids; infinite where they miss.

    `origin` [N, 3] and `linear` [N, 3, 3] map the rays (x [N, T], y [N, T], 1) to the solids' coordinates.
    """
    x, y = x[:, None, :], y[:, :, None]
    rays = [a * x + (b * y + c) for a, b, c in (linear[:, i, :, None, None].unbind(1) for i in range(3))]
    start = [origin[:, i, None, None] for i in range(3)]
    if shape == BALL:
        near, far = _quadric(start, rays)
    else:
        near, far = _slab(start[2], rays[2])
        if shape == CYLINDER:
            limits = [_quadric(start[:2], rays[:2])]
        else:
            limits = [_slab(start[i], rays[i]) for i in range(2)]
        for least, most in limits:
            near, far = torch.maximum(near, least), torch.minimum(far, most)
    return near.masked_fill_((near >= far) | (near <= NEAREST), torch.inf)


def _slab(start, ray):
    """Depths at which rays enter and leave -1..1 along one axis."""
    width = ray.abs().clamp_(min=PARALLEL).reciprocal_()
    middle = -start * torch.copysign(width, ray)
    return middle - width, middle + width


def _quadric(start, rays):
    """Depths at which rays enter and leave the unit circle's cylinder (two coordinates) or ball (three)."""
    a = sum(ray * ray for ray in rays).clamp_(min=PARALLEL**1.5)
    b = sum(point * ray for point, ray in zip(start, rays))
    c = sum(point * point for point in start) - 1
    square = b * b - a * c
    root = square.clamp(min=0).sqrt().masked_fill_(square < 0, -torch.inf)
    return (-b - root) / a, (-b + root) / a


def _inside(least, greatest, cameras, height, width):
    """Depth at which rays leave boxes from inside, and the id of the face, both [B, H, W]."""
    x, y = cameras.rays(height, width)
    exit = torch.full((len(least), height, width), torch.inf, device=least.device)
    face = torch.zeros(exit.shape, dtype=torch.int64, device=least.device)
    for axis, ids in enumerate(((1, 2), (3, 4), (5, 6))):
        a, b, c = (cameras.rotation[:, axis, i, None, None] for i in range(3))
        ray = a * x + (b * y + c)
        ray = ray.where(ray.abs() > PARALLEL, PARALLEL)
        start = cameras.position[:, axis, None, None]
        low, high = (corner[:, axis, None, None] for corner in (least, greatest))
        at = torch.where(ray > 0, high - start, low - start) / ray
        nearer = at < exit
        exit = at.where(nearer, exit)
        face = torch.where(ray > 0, ids[1], ids[0]).where(nearer, face)
    return exit, face


def surfaces(hits, parts, cameras):
    """Points on their surfaces for textures and light: position [B, H, W, 3] in the part's own axes, in metres from its
    centre, and normal [B, H, W, 3] in the camera's axes.

    In rooms, positions and axes are the world's.
    """
    batch, height, width = hits.z.shape
    x, y = cameras.rays(height, width)
    point = torch.stack((hits.z * x, hits.z * y, hits.z), -1)
    world = point.flatten(1, 2) @ cameras.rotation.mT + cameras.position[:, None]
    part = hits.part.clamp(min=0).flatten(1)
    scene = torch.arange(batch, device=part.device)[:, None]
    # One gather of all that a pixel needs to know about its part is faster than one for each.
    known = torch.cat((parts.axes.flatten(2), parts.centre, parts.half, parts.shape[..., None].float()), 2)[scene, part]
    axes = known[..., :9].view(batch, -1, 3, 3)
    local = ((world - known[..., 9:12])[..., None] * axes).sum(-2)
    unit = local / known[..., 12:15].clamp(min=1e-5)
    own = _unit_normal(unit, known[..., 12:15], known[..., 15:])
    is_room = (hits.part < 0).flatten(1)[..., None]
    normal = (axes * own[..., None, :]).sum(-1).where(~is_room, _room_normal(hits.id.flatten(1)))
    local = local.where(~is_room, world)
    shape = (batch, height, width, 3)
    return local.view(shape), (normal @ cameras.rotation).view(shape)


def _unit_normal(unit, half, shape):
    """Outward normals [..., 3] at points on the unit solid, in the part's axes."""
    largest = unit.abs().argmax(-1, keepdim=True)
    box = torch.zeros_like(unit).scatter_(-1, largest, unit.gather(-1, largest).sign())
    flat = unit[..., 2:].abs() > 0.999
    upright = torch.tensor((1.0, 1.0, 0.0), device=unit.device)
    side = torch.where(flat, unit.sign() * (1 - upright), unit * upright / half.clamp(min=1e-5))
    round = unit / half.clamp(min=1e-5)
    normal = torch.where(shape == BOX, box, torch.where(shape == CYLINDER, side, round))
    return normal / normal.norm(dim=-1, keepdim=True).clamp(min=1e-9)


def _room_normal(id):
    """Normals [..., 3] of the room's faces, pointing inwards; those of ids above 6 mean nothing."""
    faces = [(0, 0, 0), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]
    return torch.tensor(faces, device=id.device, dtype=torch.float32)[id.clamp(max=FACES)]
