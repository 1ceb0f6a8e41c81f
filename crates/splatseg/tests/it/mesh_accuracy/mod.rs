//! The errors of a mesh of a synthetic room, whose surfaces are known exactly.

use glam::{DVec3, IVec3, Vec2, Vec3};
use splatseg::dataset::{Noise, Scene, SyntheticScene, SyntheticSettings};
use splatseg::geometry::{Pose, RgbdFrame};
use splatseg::mesh::TriangleMesh;
use splatseg::odometry::KeyframeView;
use splatseg::settings::SettingsLayers;
use splatseg::{Pipeline, Settings};
use std::collections::{HashMap, HashSet};
use std::error::Error;
use std::fmt;
use std::path::{Path, PathBuf};

/// Surfaces nearer than this are right, metres.
const NEAR: f32 = 0.03;
/// Surfaces are compared at one point for each cell of this size, metres, whatever the density of pixels.
const CELL: f32 = 0.02;
/// Every so many frames of the scene tell which surfaces were in view, and every so many pixels.
const FRAME_STEP: usize = 2;
const PIXEL_STEP: usize = 2;

/// How well a mesh agrees with the exact surfaces.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Errors {
    /// Percentage of the mesh's area that is within 3 cm of an exact surface.
    pub accuracy: f64,
    /// Percentage of the surfaces in view that are within 3 cm of the mesh.
    pub completeness: f64,
    /// Mean distance of the mesh from the exact surfaces, metres.
    pub mean: f64,
    /// Number of triangles.
    pub triangles: usize,
}

impl fmt::Display for Errors {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { accuracy, completeness, mean, triangles } = self;
        write!(formatter, "accuracy {accuracy:.2} %, completeness {completeness:.2} %, ")?;
        write!(formatter, "mean distance {:.1} mm, {triangles} triangles", 1e3 * mean)
    }
}

/// Makes a map of a scene and saves it. `poses` is `given` or `track`.
pub fn mapped(scene: &SyntheticScene, poses: &str, path: &Path) -> Result<PathBuf, Box<dyn Error>> {
    let mut layers = SettingsLayers::default();
    layers.add_assignment(&format!("poses={poses}"))?;
    let settings: Settings = layers.resolve()?;
    let mut pipeline = Pipeline::builder(&settings).build()?;
    for index in 0..scene.frame_count() {
        let frame = scene.read_frame(index)?;
        let (color, depth) = (frame.color().clone(), frame.depth().clone());
        let pose = *frame.world_from_camera();
        pipeline.step(&RgbdFrame::new(format!("{index}"), color, depth, *frame.intrinsics(), pose)?)?;
    }
    pipeline.save_memory(path)?;
    Ok(path.to_owned())
}

/// Compares a mesh with the surfaces of a scene. The map's world is put over the scene's by the pose of the first keyframe,
/// which is that of the first frame.
pub fn errors(
    mesh: &TriangleMesh,
    keyframes: &[KeyframeView],
    scene: &SyntheticScene,
) -> Result<Errors, Box<dyn Error>> {
    let first = keyframes.first().ok_or("no keyframes")?;
    let exact = SyntheticScene::new(SyntheticSettings { noise: Noise::None, ..scene.settings().clone() })?;
    let scene_from_map = *exact.read_frame(0)?.world_from_camera() * first.world_from_camera.inverse();
    let samples = samples_of(mesh, &scene_from_map);
    let last = scene.frame_count() - 1;
    let (mut near, mut area, mut sum) = (0.0, 0.0, 0.0);
    for (point, weight) in &samples {
        let distance = exact.distance_to_surface(*point, last);
        near += if distance <= NEAR { *weight } else { 0.0 };
        sum += f64::from(distance) * weight;
        area += weight;
    }
    let grid = Grid::new(samples.into_iter().map(|(point, _)| point));
    let seen = points_in_view(&exact)?;
    let found = seen.iter().filter(|point| grid.has_near(**point)).count();
    Ok(Errors {
        accuracy: 100.0 * near / area,
        completeness: 100.0 * found as f64 / seen.len() as f64,
        mean: sum / area,
        triangles: mesh.triangles.len(),
    })
}

/// Points of a mesh with the area around each: corners and middles of all triangles.
fn samples_of(mesh: &TriangleMesh, scene_from_map: &Pose) -> Vec<(Vec3, f64)> {
    let place = |position: Vec3| {
        let world: DVec3 = position.as_dvec3() + mesh.origin;
        (scene_from_map.rotation() * world + scene_from_map.translation()).as_vec3()
    };
    let samples = |triangle: &[u32; 3]| {
        let [a, b, c] = triangle.map(|vertex| place(mesh.positions[vertex as usize]));
        let area = f64::from(0.5 * (b - a).cross(c - a).length());
        [a, b, c, (a + b + c) / 3.0].map(|point| (point, 0.25 * area))
    };
    mesh.triangles.iter().flat_map(samples).collect()
}

/// The surfaces that the frames of a scene show: one point for each cell.
fn points_in_view(exact: &SyntheticScene) -> Result<Vec<Vec3>, Box<dyn Error>> {
    let (mut cells, mut points) = (HashSet::new(), Vec::new());
    for index in (0..exact.frame_count()).step_by(FRAME_STEP) {
        let frame = exact.read_frame(index)?;
        for row in (0..frame.depth().height()).step_by(PIXEL_STEP) {
            for column in (0..frame.depth().width()).step_by(PIXEL_STEP) {
                let depth = frame.depth()[(column, row)];
                let pixel = Vec2::new(column as f32, row as f32);
                let point = frame.world_from_camera().to_world(frame.intrinsics().unproject(pixel, depth)).as_vec3();
                if depth > 0.0 && cells.insert((point / CELL).floor().as_ivec3()) {
                    points.push(point);
                }
            }
        }
    }
    Ok(points)
}

/// Points that are found by their place.
struct Grid(HashMap<IVec3, Vec<Vec3>>);

impl Grid {
    fn new(points: impl Iterator<Item = Vec3>) -> Self {
        let mut cells: HashMap<IVec3, Vec<Vec3>> = HashMap::new();
        points.for_each(|point| cells.entry((point / NEAR).floor().as_ivec3()).or_default().push(point));
        Self(cells)
    }

    fn has_near(&self, point: Vec3) -> bool {
        let cell = (point / NEAR).floor().as_ivec3();
        let around = (0..27).map(|index| cell + IVec3::new(index % 3 - 1, index / 3 % 3 - 1, index / 9 - 1));
        around.filter_map(|cell| self.0.get(&cell)).flatten().any(|other| other.distance(point) <= NEAR)
    }
}
