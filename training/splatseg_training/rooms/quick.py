"""Colours of a room in a tenth of the time of `render.py`: direct light with soft shadows, ambient light and simple mirrors
by casting rays, and approximations of Blender's textures. For training a network that names things, of which only small
crops are seen. Needs `embreex`.
"""

import cv2
import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from .cast import View
from .quick_textures import albedo

# Images are rendered this much larger, which makes edges smooth.
OVERSAMPLED = 1.25
AMBIENT_RAYS = 2
AMBIENT_REACH = 1.5  # metres
LEAST_SHARE = 0.03  # of a point's light, for shadows of a light
NEAR = 1e-3  # metres between a surface and the rays that start there


class Surfaces:
    """The triangles of a finished room: what is needed to shade a point of each."""

    def __init__(self, room):
        self.recipes, numbers = [], {}
        slots, normals, frames, boxes = [], [], [], []
        for placed in room.placed:
            mesh, count = placed.thing.mesh, len(placed.thing.triangles)
            own = np.zeros(count, np.int32)
            mesh.loop_triangles.foreach_get("material_index", own)
            corner = np.zeros(count * 9, np.float32)
            mesh.loop_triangles.foreach_get("split_normals", corner)
            keys = []
            for material in list(mesh.materials) or [None]:
                key = material.name if material else None
                if key not in numbers:
                    numbers[key] = len(self.recipes)
                    self.recipes.append(room.paint.recipes[key])
                keys.append(numbers[key])
            slots.append(np.array(keys)[np.minimum(own, len(keys) - 1)])
            normals.append(corner.reshape(-1, 3, 3))
            frames.append((placed.x, placed.y, placed.z, placed.yaw))
            points = placed.thing.triangles.reshape(-1, 3)
            boxes.append(np.stack([points.min(0), np.maximum(np.ptp(points, axis=0), 1e-6)]))
        self.slots, self.normals = np.concatenate(slots), np.concatenate(normals)
        self.frames, self.boxes = np.array(frames), np.array(boxes)
        self.triangles = np.concatenate(room.triangles).astype(np.float32)
        self.things = np.concatenate(room.ids) - 1
        self.scene = EmbreeScene()
        TriangleMesh(self.scene, self.triangles)

    def cast(self, origins, directions):
        """The first hits of rays: triangle (-1 for none), distance in lengths of the direction, u and v."""
        hits = self.scene.run(origins.astype(np.float32), directions.astype(np.float32), output=1)
        return hits["primID"], hits["tfar"], hits["u"], hits["v"]

    def reached(self, origins, directions, reach):
        """True where a ray hits nothing before `reach`, in lengths of its direction."""
        far = np.broadcast_to(np.float32(reach), len(origins)).copy()
        return self.scene.run(origins.astype(np.float32), directions.astype(np.float32), far, query="OCCLUDED") != 0

    def colours(self, triangle, point, local_normal):
        """Base colour [n, 3] and light of its own [n, 3], as the room's materials have them."""
        things = self.things[triangle]
        x, y, z, yaw = self.frames[things].T
        offset = point - np.stack([x, y, z], 1)
        local = np.stack(
            [
                np.cos(yaw) * offset[:, 0] + np.sin(yaw) * offset[:, 1],
                np.cos(yaw) * offset[:, 1] - np.sin(yaw) * offset[:, 0],
                offset[:, 2],
            ],
            1,
        )
        slots = self.slots[triangle]
        base, own = np.zeros((len(point), 3)), np.zeros((len(point), 3))
        order = np.argsort(slots, kind="stable")
        for part in np.split(order, np.flatnonzero(np.diff(slots[order])) + 1):
            recipe = self.recipes[slots[part[0]]]
            share = (local[part] - self.boxes[things[part], 0]) / self.boxes[things[part], 1]
            base[part] = albedo(recipe, local[part], local_normal[part], share)
            own[part] = recipe.glow * base[part]
        return base, own

    def normals_at(self, triangle, u, v):
        """Normals of hits in the thing's and in the room's axes."""
        corners = self.normals[triangle]
        local = (
            corners[:, 0] + u[:, None] * (corners[:, 1] - corners[:, 0]) + v[:, None] * (corners[:, 2] - corners[:, 0])
        )
        local /= np.maximum(np.linalg.norm(local, axis=1, keepdims=True), 1e-9)
        yaw = self.frames[self.things[triangle], 3]
        world = np.stack(
            [
                np.cos(yaw) * local[:, 0] - np.sin(yaw) * local[:, 1],
                np.sin(yaw) * local[:, 0] + np.cos(yaw) * local[:, 1],
                local[:, 2],
            ],
            1,
        )
        return local, world


class QuickRenderer:
    """Renders views of a finished room with a Camera of `cast`."""

    def __init__(self, room, camera, rng):
        self.surfaces, self.lights, self.rng = Surfaces(room), room.lights, rng
        self.exact = camera
        self.camera = camera._replace(
            width=round(camera.width * OVERSAMPLED), height=round(camera.height * OVERSAMPLED)
        )
        self.exposure = 1.0
        self.goal = room.paint.uniform(0.16, 0.26)
        self.ambient = rng.uniform(0.2, 0.45)

    def expose(self, poses):
        """Sets the exposure from a few small views, as a camera would."""
        camera, self.camera = (
            self.camera,
            self.exact._replace(width=self.exact.width // 5, height=self.exact.height // 5),
        )
        light = np.concatenate([self._radiance(pose)[0].mean(-1).ravel() for pose in poses])
        self.camera = camera
        self.exposure = self.goal / np.exp(np.mean(np.log(light + 1e-3)))

    def colours(self, pose, rng):
        """Renders the view from a pose with camera noise: [H, W, 3] uint8 RGB."""
        light, own = self._radiance(pose)
        image = displayed(light * self.exposure + own).astype(np.float32)
        image = 255 * cv2.resize(image, self.exact[:2], interpolation=cv2.INTER_AREA)
        image += rng.normal(size=image.shape) * 1.2 + rng.normal(size=(*image.shape[:2], 1)) * 1.2
        return np.clip(image + 0.5, 0, 255).astype(np.uint8)

    def view(self, pose):
        """The exact View from a pose, as `Caster.cast`."""
        directions = self.exact.directions()
        rays = directions.reshape(-1, 3) @ pose[:3, :3].T
        triangle, distance, _, _ = self.surfaces.cast(np.broadcast_to(pose[:3, 3], rays.shape), rays)
        shape = directions.shape[:2]
        found = triangle >= 0
        depth = np.where(found, distance, 0).reshape(shape)
        return View(
            depth, np.where(found, self.surfaces.things[triangle] + 1, 0).reshape(shape), triangle.reshape(shape)
        )

    def _radiance(self, pose):
        """Light [H, W, 3] that the view's surfaces reflect, in any unit, and light of their own, for the display."""
        directions = self.camera.directions()
        shape = directions.shape
        rays = directions.reshape(-1, 3) @ pose[:3, :3].T
        origins = np.broadcast_to(pose[:3, 3], rays.shape)
        triangle, distance, u, v = self.surfaces.cast(origins, rays)
        seen = np.flatnonzero(triangle >= 0)
        light, own = np.zeros((len(rays), 3)), np.zeros((len(rays), 3))
        hit = triangle[seen]
        point = origins[seen] + distance[seen, None] * rays[seen]
        local, normal = self.surfaces.normals_at(hit, u[seen], v[seen])
        base, own[seen] = self.surfaces.colours(hit, point, local)
        facing = (normal * rays[seen]).sum(1) > 0
        normal[facing] *= -1
        whole = np.full((len(rays), 4), -1.0, np.float32)
        whole[seen, :3], whole[seen, 3] = normal, self.surfaces.things[hit]
        falling = self._falling(point, normal, whole.reshape(*shape[:2], 4), seen)
        light[seen] = base * falling
        self._add_mirrored(light, seen, hit, point, normal, rays[seen], base, falling)
        return light.reshape(shape), own.reshape(shape)

    def _falling(self, point, normal, guide, seen):
        """Light [n, 3] that falls on points, smoothed within things against the noise of few rays."""
        start = point + NEAR * normal
        parts = [self._from(light, start, normal) for light in self.lights]
        level = LEAST_SHARE * sum(lit for lit, _, _ in parts)
        direct = np.zeros(point.shape)
        for light, (lit, away, reach) in zip(self.lights, parts):
            strong = lit > level
            lit[strong] *= self.surfaces.reached(start[strong], away[strong], reach)
            direct += lit[:, None] * np.array(light.colour)
        ambient = np.zeros(len(point))
        for _ in range(AMBIENT_RAYS):
            away = normal + _directions(len(point), self.rng)
            away /= np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9)
            ambient += self.surfaces.reached(start, away, AMBIENT_REACH) / AMBIENT_RAYS
        light = np.zeros((*guide.shape[:2], 4), np.float32)
        light.reshape(-1, 4)[seen, :3], light.reshape(-1, 4)[seen, 3] = direct, ambient
        for step in (1, 2):
            light = _smoothed(light, guide, step)
        light = light.reshape(-1, 4)[seen].astype(float)
        return light[:, :3] + self.ambient * direct.mean(0) * (0.35 + 0.65 * light[:, 3:])

    def _from(self, light, start, normal):
        """Light [n] from one place of a light for each point, without shadows; the ways there, and their lengths."""
        aim = np.array(light.aim, float)
        aim /= np.linalg.norm(aim)
        if light.kind == "SUN":
            away = -aim + light.size * _directions(len(start), self.rng)
            return np.maximum((away * normal).sum(1), 0) * light.watts, away, 20.0
        if light.kind == "AREA":
            side = np.cross(aim, [0, 0, 1.0]) if abs(aim[2]) < 0.9 else np.array([1.0, 0, 0])
            side /= np.linalg.norm(side)
            up = np.cross(side, aim)
            across, along = self.rng.uniform(-0.5, 0.5, (2, len(start), 1))
            place = np.array(light.position) + across * light.size * side + along * light.height * up
            strength = light.watts / np.pi
        else:
            place = np.array(light.position) + light.size * _directions(len(start), self.rng)
            strength = light.watts / (4 * np.pi) / np.pi
        away = place - start
        square = np.maximum((away**2).sum(1), 1e-4)
        towards = away / np.sqrt(square)[:, None]
        lit = np.maximum((towards * normal).sum(1), 0) / square * strength
        if light.kind == "AREA":
            lit *= np.maximum(-(towards @ aim), 0)
        return lit, away, 0.995

    def _add_mirrored(self, light, seen, hit, point, normal, rays, base, falling):
        """What smooth surfaces mirror: the colours of what a ray meets, in the light of the mirror's own place."""
        recipes = [self.surfaces.recipes[slot] for slot in range(len(self.surfaces.recipes))]
        metal = np.array([recipe.metal for recipe in recipes])[self.surfaces.slots[hit]]
        smooth = np.array([max(0.0, 1 - 2 * recipe.rough) for recipe in recipes])[self.surfaces.slots[hit]]
        towards = rays / np.linalg.norm(rays, axis=1, keepdims=True)
        cosine = np.abs((towards * normal).sum(1))
        share = np.where(metal > 0.5, 1.0, smooth * (0.04 + 0.96 * (1 - cosine) ** 5))
        chosen = np.flatnonzero(share > 0.05)
        if not len(chosen):
            return
        normal, towards = normal[chosen], towards[chosen]
        away = towards - 2 * (towards * normal).sum(1, keepdims=True) * normal
        away += (0.3 * (1 - smooth[chosen]))[:, None] * _directions(len(chosen), self.rng)
        triangle, distance, u, v = self.surfaces.cast(point[chosen] + NEAR * normal, away)
        met = triangle >= 0
        mirrored = np.zeros((len(chosen), 3))
        place = point[chosen][met] + distance[met, None] * away[met]
        local, _ = self.surfaces.normals_at(triangle[met], u[met], v[met])
        colour, own = self.surfaces.colours(triangle[met], place, local)
        mirrored[met] = colour * falling[chosen][met].mean(1, keepdims=True) + own / self.exposure
        tint = np.where(metal[chosen, None] > 0.5, base[chosen], 1.0)
        part, rows = share[chosen, None], seen[chosen]
        light[rows] = (1 - part) * light[rows] + part * tint * mirrored


def _smoothed(values, guide, step):
    """The mean [H, W, C] of 9 pixels `step` apart, of those that show the same thing [.., 3] with a similar normal."""
    height, width = values.shape[:2]
    total, count = values.copy(), np.ones((height, width, 1), np.float32)
    for down in (-step, 0, step):
        for right in (-step, 0, step):
            if not (down or right):
                continue
            here = np.s_[max(down, 0) : height + min(down, 0), max(right, 0) : width + min(right, 0)]
            there = np.s_[max(-down, 0) : height + min(-down, 0), max(-right, 0) : width + min(-right, 0)]
            similar = np.einsum("hwc,hwc->hw", guide[here][..., :3], guide[there][..., :3]) > 0.9
            weight = (similar & (guide[here][..., 3] == guide[there][..., 3]))[..., None].astype(np.float32)
            total[here] += weight * values[there]
            count[here] += weight
    return total / count


def _directions(count, rng):
    """Random directions [count, 3]."""
    away = rng.standard_normal((count, 3), np.float32)
    return away / np.linalg.norm(away, axis=1, keepdims=True)


INSET = np.array(
    [
        [0.84248, 0.07843, 0.07922],
        [0.04233, 0.87847, 0.07917],
        [0.04238, 0.07843, 0.87914],
    ]
)


def displayed(light):
    """Linear light [.., 3] as values 0 to 1 of a display, with a curve like that of Blender's AgX (the polynomial is that of
    Benjamin Wrensch's approximation), and more contrast."""
    x = np.log2(np.maximum(light @ INSET.T, 1e-10))
    x = np.clip((x + 12.47393) / 16.5, 0, 1)
    x = ((((15.5 * x - 40.14) * x + 31.96) * x - 6.868) * x + 0.4298) * x * x + 0.1191 * x - 0.00232
    x = np.clip(x, 0, 1)
    return x + 0.25 * (x - 0.45) * 4 * x * (1 - x)
