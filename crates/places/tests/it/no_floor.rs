//! Maps without a plan, and the reasons given.

use splatseg_geometry::Pose;
use splatseg_memory::{MemorySettings, SplatMemory};
use splatseg_objects::DepthView;
use splatseg_places::{FloorPlan, PlanError, PlanSettings};
use splatseg_test_scenes::{camera, wall};

fn plan(views: &[DepthView], settings: PlanSettings) -> Result<FloorPlan, PlanError> {
    let memory = SplatMemory::new(MemorySettings::default(), 0, &mut |_| {}).unwrap();
    FloorPlan::new(&memory.map(), views, settings)
}

#[test]
fn maps_without_keyframes_or_floor_are_refused() {
    assert_eq!(plan(&[], PlanSettings::default()).unwrap_err(), PlanError::NoKeyframes);
    let frame = wall("wall", camera(80, 60, 70.0), 2.0, Pose::IDENTITY);
    let view = |depth: splatseg_geometry::Image<f32>| DepthView {
        world_from_camera: Pose::IDENTITY,
        intrinsics: camera(80, 60, 70.0),
        depth,
    };
    let depth = frame.depth().clone().into_owned();
    assert_eq!(plan(&[view(depth.clone())], PlanSettings::default()).unwrap_err(), PlanError::NoFloor);
    for value in [0.0, f32::NAN, f32::INFINITY, -1.0] {
        let found = plan(&[view(depth.map(|_| value))], PlanSettings::default());
        assert_eq!(found.unwrap_err(), PlanError::NoFloor, "{value}");
    }
}

#[test]
fn settings_out_of_range_are_named() {
    let error = |settings: PlanSettings| settings.validated().unwrap_err().to_string();
    let default = PlanSettings::default();
    assert_eq!(error(PlanSettings { resolution: 0.0, ..default }), "resolution: found 0, expected 0.01 to 1");
    assert!(error(PlanSettings { max_height: 0.1, ..default }).starts_with("max_height: found 0.1"));
    assert!(error(PlanSettings { min_height: f64::NAN, ..default }).starts_with("min_height: found NaN"));
    assert!(error(PlanSettings { max_range: 1e9, ..default }).starts_with("max_range"));
}
