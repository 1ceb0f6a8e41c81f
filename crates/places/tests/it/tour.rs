//! Plans compared with the exact geometry of synthetic scenes. `cargo run --release -p splatseg-places --example tours`
//! measures more of them.

use crate::seen_tour::{SeenTour, plan_of, seen};
use glam::{DMat4, DVec2, DVec3};
use splatseg_files::StateBlock;
use splatseg_geometry::Pose;
use splatseg_places::{Cell, FloorPlan, KnownRooms, PlanFile, PlanSettings, Room, RouteError, map_server};
use splatseg_test_scenes::room;
use std::collections::BTreeMap;

#[test]
fn the_plan_of_four_rooms_is_as_they_are() {
    let tour = SeenTour::new(3, 24, "none");
    let errors = tour.errors();
    println!("IoU {:.3}, {errors:?}", errors.iou());
    assert!(errors.iou() >= 0.9, "{} {errors:?}", errors.iou());
    // The far side of a sphere overhangs by less than a cell where nothing has shown how far it reaches.
    assert_eq!(tour.wholly_inside(), 0);
    assert!(errors.inside * 2000 <= errors.both && errors.unseen * 400 <= errors.both, "{errors:?}");
    assert_eq!((tour.rooms_found(), tour.plan.rooms().len()), (4, 4), "{:?}", tour.plan.rooms());
    assert!(tour.plan.rooms().iter().all(|room| room.doors.len() == 2), "{:?}", tour.plan.rooms());
    rooms_keep_their_numbers(&tour);
    let (right, all) = tour.objects_in_rooms();
    assert!(right * 20 >= all * 19 && all > 40, "{right} of {all}");
    crate::room_names::check(&tour);
    let (found, none, touching) = tour.routes(0.2);
    println!("{found} routes, {none} without a known way");
    assert!(found > 10 && touching == 0, "{found} {none} {touching}");
    // From each thing that can be approached, the robot stands clear of everything and looks at it.
    let mut approached = 0;
    for thing in tour.scene.things() {
        match tour.plan.approach(thing.id, 0.2) {
            Ok(points) => {
                approached += 1;
                for point in points {
                    let to = thing.center.truncate().as_dvec2() - point.place;
                    assert!(glam::DVec2::from_angle(point.yaw).dot(to.normalize()) > 0.6, "{thing:?} {point:?}");
                    assert!(!tour.scene.is_occupied(point.place.as_vec2(), (0.1, 1.8)) && point.clearance_m >= 0.2);
                }
            }
            Err(error) => assert!(matches!(error, RouteError::NoApproach { .. } | RouteError::NoObject(_)), "{error}"),
        }
    }
    assert!(approached > 30, "{approached}");
    assert_eq!(tour.plan.approach(9999, 0.2), Err(RouteError::NoObject(9999)));
}

/// Numbers of rooms last from plan to plan, and from file to file.
fn rooms_keep_their_numbers(tour: &SeenTour) {
    let mut plan = tour.plan.clone();
    let mut known = KnownRooms::default();
    plan.keep_room_ids(&mut known);
    assert_eq!(plan.rooms(), tour.plan.rooms(), "the first plan numbers them");
    // Two of the rooms were known under other numbers, and one that is not in the plan.
    let middle = |id: usize| plan.frame().to_world(plan.rooms()[id].middle).to_array();
    let mut block = StateBlock::default();
    block.put("id", &[], [2_u32, 5, 6]);
    block.put("middle", &[3], [middle(3), middle(0), [900.0, 0.0, 0.0]].as_flattened().iter().copied());
    known = KnownRooms::from_block(&block).unwrap();
    plan.keep_room_ids(&mut known);
    assert_eq!(plan.rooms().iter().map(|room| room.id).collect::<Vec<_>>(), [2, 5, 7, 8]);
    let old_id = |id: u32| match id {
        2 => 4,
        5 => 1,
        7 => 2,
        _ => 3,
    };
    for room in plan.rooms() {
        let old = &tour.plan.rooms()[old_id(room.id) as usize - 1];
        assert_eq!((room.middle, room.area_m2), (old.middle, old.area_m2));
        let doors = |room: &Room, name: fn(u32) -> u32| room.doors.iter().map(|door| name(door.to)).collect::<Vec<_>>();
        assert_eq!(doors(room, old_id), doors(old, |id| id));
        assert_eq!(plan.room_at(room.middle).unwrap().id, room.id);
        // An outline is exact to a cell.
        let area: f64 = plan.room_outlines(room.id).iter().map(|outline| enclosed(outline)).sum();
        assert!((area - room.area_m2).abs() < 0.05 * room.area_m2, "{area} {}", room.area_m2);
    }
    assert!(plan.rooms_of_objects().values().all(|room| [2, 5, 7, 8].contains(room)));
    assert_eq!(KnownRooms::from_block(&known.to_block()).unwrap(), known);
    block.put("middle", &[3], [f64::NAN; 9]);
    assert!(KnownRooms::from_block(&block).is_err());
}

/// Area within a closed line, negative if it is clockwise.
fn enclosed(outline: &[DVec2]) -> f64 {
    let next = outline.iter().cycle().skip(1);
    0.5 * outline.iter().zip(next).map(|(one, other)| one.perp_dot(*other)).sum::<f64>()
}

#[test]
fn a_world_whose_y_axis_points_down_has_the_same_plan_turned() {
    let scene = room("synthetic:frames=48,width=96,height=72,objects=8,seed=5");
    let upright = plan_of(&scene, 2, Pose::IDENTITY);
    // z up becomes -y up, moved.
    let turn =
        DMat4::from_translation(DVec3::new(3.0, 1.0, -2.0)) * DMat4::from_rotation_x(std::f64::consts::FRAC_PI_2);
    let turned = plan_of(&scene, 2, Pose::from_matrix(turn).unwrap());
    assert!(upright.frame().is_world() && !turned.frame().is_world());
    assert!(turned.frame().floor_height().abs() < 1e-9 && upright.frame().floor_height().abs() < 0.02);
    let (one, other) = (upright.grid().area(Cell::Free), turned.grid().area(Cell::Free));
    assert!(one > 3.0 && (one - other).abs() < 0.06 * one, "{one} {other}");
    // The same place of the world, on both plans.
    let place = upright.frame().to_world(upright.rooms()[0].middle);
    let moved = turned.frame().to_plan(Pose::from_matrix(turn).unwrap().to_world(place.as_vec3()));
    assert_eq!(turned.grid().at(moved), upright.grid().at(upright.rooms()[0].middle));
    let yaml = map_server::yaml(turned.grid(), turned.frame(), "a.pgm");
    assert!(
        yaml.contains("# rotation: [")
            && !map_server::yaml(upright.grid(), upright.frame(), "a.pgm").contains("rotation")
    );
}

#[test]
fn the_floor_below_the_camera_is_free_if_that_is_wanted() {
    let scene = room("synthetic:frames=48,width=96,height=72,objects=8,seed=5");
    let (memory, views) = seen(&scene, 2, Pose::IDENTITY);
    let plan = |free_path| {
        FloorPlan::new(&memory.map(), &views, PlanSettings { free_path, ..PlanSettings::default() }).unwrap()
    };
    let (without, with) = (plan(0.0), plan(0.3));
    let shape = &without.grid().shape;
    let cameras: Vec<_> = views.iter().map(|view| view.world_from_camera.translation().truncate()).collect();
    let changed: Vec<usize> =
        (0..shape.len()).filter(|cell| without.grid().cells[*cell] != with.grid().cells[*cell]).collect();
    assert!(changed.len() > 20, "{}", changed.len());
    for cell in changed {
        assert_eq!((without.grid().cells[cell], with.grid().cells[cell]), (Cell::Unknown, Cell::Free));
        let center = shape.center(cell);
        // Between two keyframes, the way is farther from each by up to half their distance.
        assert!(cameras.iter().any(|camera| camera.distance(center) <= 0.3 + 0.5), "{center}");
        assert!(!scene.is_occupied(center.as_vec2(), (0.1, 1.8)), "{center}");
    }
    assert!(matches!(
        FloorPlan::new(&memory.map(), &views, PlanSettings { free_path: 2.0, ..PlanSettings::default() }),
        Err(splatseg_places::PlanError::Setting { name: "free_path", .. })
    ));
}

#[test]
fn the_files_read_back_as_map_server_reads_them() {
    let scene = room("synthetic:frames=24,width=96,height=72,objects=6,seed=2");
    let plan = plan_of(&scene, 2, Pose::IDENTITY);
    let grid = plan.grid();
    let (pgm, yaml) = (map_server::pgm(grid), map_server::yaml(grid, plan.frame(), "room.pgm"));
    let header = format!("P5\n{} {}\n255\n", grid.shape.width, grid.shape.height);
    let pixels = pgm.strip_prefix(header.as_bytes()).unwrap();
    let value = |key: &str| yaml.lines().find_map(|line| line.strip_prefix(&format!("{key}: "))).unwrap().to_owned();
    let number = |key: &str| value(key).parse::<f64>().unwrap();
    let origin: Vec<f64> =
        value("origin").trim_matches(['[', ']']).split(", ").map(|part| part.parse().unwrap()).collect();
    assert_eq!(
        (value("image").as_str(), value("mode").as_str(), value("negate").as_str()),
        ("\"room.pgm\"", "trinary", "0")
    );
    for (index, pixel) in pixels.iter().enumerate() {
        let (column, row) = (index % grid.shape.width, index / grid.shape.width);
        let occupancy = (255.0 - f64::from(*pixel)) / 255.0;
        let read = match occupancy {
            occupancy if occupancy > number("occupied_thresh") => Cell::Occupied,
            occupancy if occupancy < number("free_thresh") => Cell::Free,
            _ => Cell::Unknown,
        };
        let up = (grid.shape.height - 1 - row) as f64 + 0.5;
        let place =
            glam::DVec2::new(origin[0], origin[1]) + glam::DVec2::new(column as f64 + 0.5, up) * number("resolution");
        assert_eq!(read, grid.at(place));
    }
    assert!([Cell::Free, Cell::Occupied, Cell::Unknown].into_iter().all(|kind| grid.count(kind) > 20));
    // Equal maps give equal bytes, and the JSON file can be read.
    let file = PlanFile::new(&plan, &BTreeMap::from([(8, "mug".to_owned())]), None, 0.2);
    let text = file.to_json().unwrap();
    assert_eq!(serde_json::from_str::<PlanFile>(&text).unwrap(), file);
    let again = plan_of(&scene, 2, Pose::IDENTITY);
    assert_eq!(PlanFile::new(&again, &BTreeMap::from([(8, "mug".to_owned())]), None, 0.2).to_json().unwrap(), text);
}
