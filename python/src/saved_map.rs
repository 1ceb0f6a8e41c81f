//! A saved map, without a pipeline: its objects, floor plan and mesh.

use crate::arrays::to_rows;
use crate::errors::{runtime_error, value_error};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use splatseg::mesh::{MeshSettings, TriangleMesh, reconstruct};
use splatseg::odometry::keyframe_views;
use splatseg::output::segment_color;
use splatseg::pipeline::NamedMap;
use splatseg::places::{FloorPlan as Plan, PlanFile, PlanPicture, PlanSettings, Route};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError, TryLockError};

/// The file of a map.
#[pyclass(frozen, module = "splatseg._splatseg")]
pub struct SavedMap {
    path: PathBuf,
    map: Mutex<NamedMap>,
}

/// A floor plan of a map, with the map's names.
#[pyclass(frozen, module = "splatseg._splatseg")]
pub struct FloorPlan {
    /// The plan; its rooms may get other names.
    plan: Mutex<Plan>,
    labels: std::collections::BTreeMap<u32, String>,
}

/// Vertices, colours, ids and triangles.
type Mesh = (Py<PyArray2<f64>>, Py<PyArray2<u8>>, Py<PyArray1<u32>>, Py<PyArray2<u32>>);
/// Corners, length and clearance, metres.
type FoundRoute = (Py<PyArray2<f64>>, f64, f64);

#[pymethods]
impl SavedMap {
    #[new]
    fn new(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let map = py.detach(|| NamedMap::load(&path)).map_err(value_error)?;
        Ok(Self { path, map: Mutex::new(map) })
    }

    /// `objects.json` of the map.
    fn objects(&self) -> PyResult<String> {
        self.lock()?.object_list().to_json().map_err(runtime_error)
    }

    /// The scene graph as JSON.
    fn scene_graph(&self, py: Python<'_>) -> PyResult<String> {
        let map = self.lock()?;
        let map = &*map;
        let graph = py.detach(move || map.scene_graph()).map_err(|error| self.wrong(error))?;
        graph.to_json().map_err(runtime_error)
    }

    /// Gives an object a label, or takes it away.
    fn name_object(&self, id: u32, label: Option<&str>) -> PyResult<()> {
        let mut map = self.lock()?;
        if !map.memory.map().carried_ids().contains(&id) {
            return Err(self.wrong(format!("found no object {id}")));
        }
        map.names.set_by_hand(id, label).map_err(value_error)
    }

    /// Gives a room of a plan a name, or takes it away.
    fn name_room(&self, plan: &FloorPlan, number: u32, name: Option<&str>) -> PyResult<()> {
        self.lock()?.name_room(&mut plan.lock(), number, name).map_err(value_error)
    }

    /// Writes the map.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let map = self.lock()?;
        let map = &*map;
        py.detach(move || map.save(path)).map_err(runtime_error)
    }

    /// Makes a plan.
    fn floor_plan(
        &self,
        py: Python<'_>,
        resolution: f64,
        min_height: f64,
        max_height: f64,
        max_range: f64,
        free_path: f64,
    ) -> PyResult<FloorPlan> {
        let map = self.lock()?;
        let map = &*map;
        let settings = PlanSettings { resolution, min_height, max_height, max_range, free_path };
        let plan = py.detach(move || map.floor_plan(settings)).map_err(|error| self.wrong(error))?;
        let labels = map.names.labels().map(|(id, label)| (id, label.to_owned())).collect();
        Ok(FloorPlan { plan: Mutex::new(plan), labels })
    }

    /// Makes a mesh.
    fn mesh(&self, py: Python<'_>, voxel: Option<f32>) -> PyResult<Mesh> {
        let map = self.lock()?;
        let map = &*map;
        let mesh = py.detach(move || mesh_of(map, voxel)).map_err(|problem| self.wrong(problem))?;
        let vertices = mesh.positions.iter().map(|position| (position.as_dvec3() + mesh.origin).to_array());
        Ok((
            to_rows(py, vertices)?,
            to_rows(py, mesh.colors.iter().copied())?,
            PyArray1::from_vec(py, mesh.ids).unbind(),
            to_rows(py, mesh.triangles.iter().copied())?,
        ))
    }
}

impl SavedMap {
    /// Locks the map. Fails if another thread is using it.
    fn lock(&self) -> PyResult<MutexGuard<'_, NamedMap>> {
        match self.map.try_lock() {
            Ok(map) => Ok(map),
            Err(TryLockError::Poisoned(poisoned)) => Ok(poisoned.into_inner()),
            Err(TryLockError::WouldBlock) => {
                Err(PyRuntimeError::new_err("the map is in use: use it from one thread at a time"))
            }
        }
    }

    fn wrong(&self, problem: impl std::fmt::Display) -> PyErr {
        value_error(format!("{}: {problem}", Path::display(&self.path)))
    }
}

fn mesh_of(map: &NamedMap, voxel: Option<f32>) -> Result<TriangleMesh, String> {
    let keyframes = map.keyframes.as_ref().ok_or("has no keyframes, whose depth shows the surfaces")?;
    let keyframes = keyframe_views(keyframes, None).map_err(|error| error.to_string())?;
    reconstruct(&map.memory.map(), &keyframes, &MeshSettings { voxel }).map_err(|error| error.to_string())
}

#[pymethods]
impl FloorPlan {
    /// The plan as JSON, with approach points for a robot of a radius.
    fn data(&self, py: Python<'_>, radius: f64) -> PyResult<String> {
        if !(0.0..=5.0).contains(&radius) {
            return Err(value_error(format!("robot_radius is {radius}, expected 0 to 5")));
        }
        py.detach(|| PlanFile::new(&self.lock(), &self.labels, None, radius).to_json()).map_err(runtime_error)
    }

    /// The cells as in `nav_msgs/OccupancyGrid`, `(height, width)`.
    fn grid(&self, py: Python<'_>) -> PyResult<Py<PyArray2<i8>>> {
        let plan = self.lock();
        let size = [plan.grid().shape.height, plan.grid().shape.width];
        Ok(PyArray1::from_vec(py, plan.grid().ros_values()).reshape(size)?.unbind())
    }

    /// The number of the room of each cell, `(height, width)`; 0 for none.
    fn room_ids(&self, py: Python<'_>) -> PyResult<Py<PyArray2<u32>>> {
        let plan = self.lock();
        let shape = &plan.grid().shape;
        let room = |cell: usize| plan.room_at(shape.center(cell)).map_or(0, |room| room.id);
        let ids: Vec<u32> = (0..shape.len()).map(room).collect();
        Ok(PyArray1::from_vec(py, ids).reshape([shape.height, shape.width])?.unbind())
    }

    /// A picture, `(height, width, 3)` as bytes of rows, with its size.
    fn picture(&self, scale: usize) -> (Vec<u8>, usize, usize) {
        let content = PlanPicture { scale, ..PlanPicture::default() };
        let picture = self.lock().picture(&content, segment_color);
        (picture.pixels().as_flattened().to_vec(), picture.width(), picture.height())
    }

    /// The way between two places.
    fn route(&self, py: Python<'_>, start: [f64; 2], end: [f64; 2], radius: f64) -> PyResult<FoundRoute> {
        let route = py.detach(|| self.lock().route(start.into(), end.into(), radius)).map_err(value_error)?;
        found(py, &route)
    }

    /// The way from a place to where the robot faces an object, and the direction there, radians.
    fn route_to_object(&self, py: Python<'_>, start: [f64; 2], id: u32, radius: f64) -> PyResult<(FoundRoute, f64)> {
        let result = py.detach(|| self.lock().route_to_object(start.into(), id, radius));
        let (route, approach) = result.map_err(value_error)?;
        Ok((found(py, &route)?, approach.yaw))
    }

    /// Places from which a robot faces an object, as JSON.
    fn approach(&self, py: Python<'_>, id: u32, radius: f64) -> PyResult<String> {
        let points = py.detach(|| self.lock().approach(id, radius)).map_err(value_error)?;
        serde_json::to_string(&points).map_err(runtime_error)
    }
}

impl FloorPlan {
    fn lock(&self) -> MutexGuard<'_, Plan> {
        self.plan.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn found(py: Python<'_>, route: &Route) -> PyResult<FoundRoute> {
    let points = to_rows(py, route.points.iter().map(|point| point.to_array()))?;
    Ok((points, route.length_m, route.clearance_m))
}
