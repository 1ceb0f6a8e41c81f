//! The plan of a scene whose map learns the true ids, compared with the exact plan.

use glam::DVec2;
use splatseg_dataset::{Scene, SyntheticScene};
use splatseg_geometry::{Pose, RgbdFrame};
use splatseg_memory::{MemorySettings, SplatMemory};
use splatseg_objects::DepthView;
use splatseg_places::{Cell, FloorPlan, OccupancyGrid, PlanSettings, Route};
use splatseg_test_scenes::{ExactPlan, PlanErrors, TrueCell, room, true_cells, truth};
use std::collections::BTreeSet;

/// A scene, its plan, and the truth of each cell as far as the recording shows it.
pub struct SeenTour {
    pub scene: SyntheticScene,
    pub plan: FloorPlan,
    pub truth: Vec<TrueCell>,
}

/// The plan from every `stride`-th frame of a scene; `place` moves the world.
pub fn plan_of(scene: &dyn Scene, stride: usize, place: Pose) -> FloorPlan {
    let (memory, views) = seen(scene, stride, place);
    FloorPlan::new(&memory.map(), &views, PlanSettings::default()).unwrap()
}

/// The map from every `stride`-th frame of a scene, and what the camera saw.
pub fn seen(scene: &dyn Scene, stride: usize, place: Pose) -> (SplatMemory, Vec<DepthView>) {
    let mut memory = SplatMemory::new(MemorySettings::default(), 0, &mut |_| {}).unwrap();
    let mut views = Vec::new();
    let mut ids = 0;
    for index in (0..scene.frame_count()).step_by(stride) {
        let frame = scene.read_frame(index).unwrap();
        let (color, depth) = (frame.color().clone(), frame.depth().clone());
        let pose = place * *frame.world_from_camera();
        views.push(DepthView {
            world_from_camera: pose,
            intrinsics: *frame.intrinsics(),
            depth: depth.clone().into_owned(),
        });
        let frame = RgbdFrame::new(frame.name(), color, depth, *frame.intrinsics(), pose).unwrap();
        let recall = memory.recall(&frame);
        let labels = truth(scene, index);
        let most = labels.pixels().iter().copied().max().unwrap_or_default();
        while ids < most {
            ids = memory.new_segment().unwrap();
        }
        memory.update(recall, &labels, &BTreeSet::new()).unwrap();
    }
    (memory, views)
}

impl SeenTour {
    /// Four rooms of this seed, seen in every `stride`-th of 1800 frames.
    pub fn new(seed: u64, stride: usize, noise: &str) -> Self {
        let text = |noise: &str| format!("synthetic:frames=1800,seed={seed},width=160,height=120,tour=4,noise={noise}");
        let scene = room(&text(noise));
        let plan = plan_of(&scene, stride, Pose::IDENTITY);
        let shape = &plan.grid().shape;
        // What the frames that the map was made of show.
        let exact = room(&text("none"));
        let truth = true_cells(&exact, (&exact, stride), shape.origin, (shape.width, shape.height), shape.resolution);
        Self { scene, plan, truth }
    }

    pub fn errors(&self) -> PlanErrors {
        PlanErrors::new(self.plan.grid().cells.iter().map(|cell| *cell == Cell::Free), &self.truth)
    }

    /// Free cells that lie in a thing or a wall as a whole.
    pub fn wholly_inside(&self) -> usize {
        wholly_inside(self.plan.grid(), &self.scene)
    }

    /// For each true room, the room of the plan at its middle and how many of its free cells have that room's number.
    pub fn rooms_found(&self) -> usize {
        let mut found = BTreeSet::new();
        for number in 0..4 {
            let shape = &self.plan.grid().shape;
            let cells: Vec<usize> = (0..shape.len())
                .filter(|cell| self.truth[*cell].room == Some(number) && self.plan.grid().cells[*cell] == Cell::Free)
                .collect();
            for room in self.plan.rooms() {
                let own = cells.iter().filter(|cell| self.plan.room_at(shape.center(**cell)) == Some(room)).count();
                let all = (0..shape.len()).filter(|cell| self.plan.grid().cells[*cell] == Cell::Free);
                let of_room = all.filter(|cell| self.plan.room_at(shape.center(*cell)) == Some(room)).count();
                // Nine tenths of the true room are in it, and nine tenths of it are in the true room.
                if own * 10 >= cells.len() * 9 && own * 10 >= of_room * 9 {
                    found.insert((number, room.id));
                }
            }
        }
        found.len()
    }

    /// Objects that stand in the room that the plan has them in, and all with a place in the plan, of things.
    pub fn objects_in_rooms(&self) -> (usize, usize) {
        let (mut right, mut all) = (0, 0);
        for thing in self.scene.things() {
            let true_room = self.scene.room_at(thing.center.truncate());
            let Some(room) = self.plan.room_of(thing.id) else { continue };
            let middle_room = self.scene.room_at(room.middle.as_vec2());
            all += 1;
            right += usize::from(true_room.is_some() && true_room == middle_room);
        }
        (right, all)
    }

    /// Ways of a robot between places on free cells: found, not found, and those that touch something.
    pub fn routes(&self, radius: f64) -> (usize, usize, usize) {
        routes(&self.plan, &self.scene, radius)
    }
}

/// Free cells that lie in a thing or a wall as a whole.
pub fn wholly_inside(grid: &OccupancyGrid, exact: &dyn ExactPlan) -> usize {
    let shape = &grid.shape;
    let corner = |cell: usize, index: usize| {
        let offset = DVec2::new((index % 3) as f64 - 1.0, (index / 3) as f64 - 1.0);
        (shape.center(cell) + offset * 0.49 * shape.resolution).as_vec2()
    };
    let is_inside = |cell: &usize| (0..9).all(|index| exact.is_occupied(corner(*cell, index)));
    (0..shape.len()).filter(|cell| grid.cells[*cell] == Cell::Free).filter(is_inside).count()
}

/// True if a robot on this way touches something.
fn touches(route: &Route, exact: &dyn ExactPlan) -> bool {
    route.points.windows(2).any(|pair| {
        let steps = (pair[0].distance(pair[1]) / 0.02).ceil().max(1.0) as usize;
        (0..=steps).any(|step| {
            let place = pair[0].lerp(pair[1], step as f64 / steps as f64);
            let around = (0..32).map(|part| DVec2::from_angle(f64::from(part) / 32.0 * std::f64::consts::TAU));
            let robot = around.map(|side| place + side * route.radius_m).chain([place]);
            robot.into_iter().any(|point| exact.is_occupied(point.as_vec2()))
        })
    })
}

/// Ways of a robot between places on free cells: found, not found, and those that touch something.
pub fn routes(plan: &FloorPlan, exact: &dyn ExactPlan, radius: f64) -> (usize, usize, usize) {
    let shape = &plan.grid().shape;
    let free: Vec<DVec2> =
        (0..shape.len()).filter(|cell| plan.grid().cells[*cell] == Cell::Free).map(|cell| shape.center(cell)).collect();
    let places: Vec<DVec2> = free.iter().copied().step_by(free.len() / 24 + 1).collect();
    let (mut found, mut none, mut touching) = (0, 0, 0);
    for (index, from) in places.iter().enumerate() {
        for to in &places[index + 1..] {
            match plan.route(*from, *to, radius) {
                Ok(route) => {
                    found += 1;
                    touching += usize::from(touches(&route, exact));
                }
                Err(_) => none += 1,
            }
        }
    }
    (found, none, touching)
}
