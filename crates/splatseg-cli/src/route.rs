//! `splatseg route`: a free way between two places of a saved memory.

use super::Failure;
use super::export_plan::PlanOptions;
use clap::Args;
use glam::{DVec2, DVec3};
use serde::Serialize;
use splatseg::pipeline::NamedMap;
use splatseg_geometry::SegmentId;
use splatseg_places::{ApproachPoint, FloorPlan, Route};
use std::path::PathBuf;
use std::str::FromStr;

#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    splatseg route map.ply room:1 15                         # from the middle of a room to object 15\n  \
    splatseg route map.ply room:hall mug --json              # by names\n  \
    splatseg route map.ply 0.5,1.2 -- -2,3.1                 # x and y of the plan, metres\n  \
    splatseg route map.ply 0.5,1.2,0 15                      # x, y and z of the world, metres\n\n\
    A place is the id of an object, `room:` and the number or name of a room, coordinates, or the label of an object.\n\
    The robot keeps its whole disc on cells that are known to be free: docs/PLACES.md.")]
pub struct RouteArguments {
    /// The map: a memory saved by `run --save-memory`, `live --map` or a program
    pub map: PathBuf,
    /// Where it starts; of an object, a place that faces it
    pub from: String,
    /// Where it ends
    pub to: String,
    #[command(flatten, next_help_heading = "Plan")]
    pub plan: PlanOptions,
    /// Print the route as JSON, in the coordinates of the plan and of the world
    #[arg(long)]
    pub json: bool,
}

/// A place that the user names.
#[derive(Clone, Debug, PartialEq)]
enum Place {
    Object(SegmentId),
    Room(String),
    /// On the plan, metres.
    Plan(DVec2),
    /// In the world, metres.
    World(DVec3),
    Label(String),
}

/// The output of `--json`.
#[derive(Serialize)]
struct Printed<'a> {
    #[serde(flatten)]
    route: &'a Route,
    /// The corners in world coordinates, on the floor, metres.
    points_world: Vec<DVec3>,
    /// Where the robot stands at the end, if that is an object.
    approach: Option<ApproachPoint>,
}

/// Prints the way.
pub fn route(arguments: &RouteArguments) -> Result<(), Failure> {
    let (settings, radius) = (arguments.plan.settings()?, arguments.plan.radius()?);
    let [from, to] = [&arguments.from, &arguments.to].map(|text| Place::from_str(text));
    let (from, to) = (from.map_err(Failure::input)?, to.map_err(Failure::input)?);
    let map = NamedMap::load(&arguments.map).map_err(Failure::input)?;
    let wrong = |problem: String| Failure::input(format!("{}: {problem}", arguments.map.display()));
    let plan = map.floor_plan(settings).map_err(|error| wrong(error.to_string()))?;
    let from = match resolved(&from, &map, &plan).map_err(wrong)? {
        Resolved::Place(place) => place,
        Resolved::Object(id) => {
            let points = plan.approach(id, radius).map_err(|error| wrong(error.to_string()))?;
            points.first().map(|point| point.place).ok_or_else(|| wrong(format!("no place faces object {id}")))?
        }
    };
    let found = match resolved(&to, &map, &plan).map_err(wrong)? {
        Resolved::Place(place) => plan.route(from, place, radius).map(|route| (route, None)),
        Resolved::Object(id) => plan.route_to_object(from, id, radius).map(|(route, approach)| (route, Some(approach))),
    };
    let (route, approach) = found.map_err(|error| wrong(error.to_string()))?;
    let points_world = route.points.iter().map(|point| plan.frame().to_world(*point)).collect();
    let printed = Printed { route: &route, points_world, approach };
    if arguments.json {
        say!("{}", serde_json::to_string(&printed).map_err(Failure::runtime)?);
        return Ok(());
    }
    say!("{:.2} m, at least {:.2} m from what is not known to be free", route.length_m, route.clearance_m);
    for point in &route.points {
        say!("{:.3} {:.3}", point.x, point.y);
    }
    if let Some(ApproachPoint { yaw, distance_m, .. }) = approach {
        say!("then turn to {:.0} degrees: the object is {distance_m:.2} m away", yaw.to_degrees());
    }
    Ok(())
}

/// A place that was found.
enum Resolved {
    Place(DVec2),
    Object(SegmentId),
}

fn resolved(place: &Place, map: &NamedMap, plan: &FloorPlan) -> Result<Resolved, String> {
    match place {
        Place::Object(id) => Ok(Resolved::Object(*id)),
        Place::Plan(place) => Ok(Resolved::Place(*place)),
        Place::World(place) => Ok(Resolved::Place(plan.frame().to_plan(*place))),
        Place::Room(name) => {
            let is_it = |id: u32, other: Option<&str>| {
                name.parse() == Ok(id) || other.is_some_and(|other| other.to_lowercase() == name.to_lowercase())
            };
            let mut rooms = plan.rooms().iter().filter(|room| is_it(room.id, room.name.as_deref()));
            match (rooms.next(), rooms.next()) {
                (Some(room), None) => Ok(Resolved::Place(room.middle)),
                (Some(_), Some(_)) => Err(format!("room:{name}: several rooms have this name, give a number")),
                (None, _) => {
                    Err(format!("room:{name}: found no such room, expected 1 to {} or a name", plan.rooms().len()))
                }
            }
        }
        Place::Label(label) => {
            let is_it = |other: &str| other.to_lowercase() == label.to_lowercase();
            let ids: Vec<SegmentId> = map.names.labels().filter(|(_, other)| is_it(other)).map(|(id, _)| id).collect();
            match ids[..] {
                [id] => Ok(Resolved::Object(id)),
                [] => Err(format!("found no object with the label {label:?}: give an id, room:NUMBER or x,y")),
                _ => Err(format!("the objects {ids:?} have the label {label:?}: give an id")),
            }
        }
    }
}

impl FromStr for Place {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = |problem: &str| Err(format!("found the place {text:?}, expected {problem}"));
        if let Ok(id) = text.parse() {
            return Ok(Self::Object(id));
        }
        if let Some(room) = text.strip_prefix("room:") {
            return Ok(Self::Room(room.to_owned()));
        }
        let numbers: Vec<f64> = text.split(',').map_while(|part| part.trim().parse().ok()).collect();
        if numbers.len() != text.split(',').count() {
            return if text.trim().is_empty() {
                wrong("an object, a room or coordinates")
            } else {
                Ok(Self::Label(text.to_owned()))
            };
        }
        if numbers.iter().any(|number| !number.is_finite()) {
            return wrong("finite coordinates");
        }
        match numbers[..] {
            [x, y] => Ok(Self::Plan(DVec2::new(x, y))),
            [x, y, z] => Ok(Self::World(DVec3::new(x, y, z))),
            _ => wrong("an id, or two or three coordinates"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_ids_rooms_coordinates_or_labels() {
        let place = |text: &str| text.parse::<Place>();
        assert_eq!(place("15"), Ok(Place::Object(15)));
        assert_eq!(place("room:guest room"), Ok(Place::Room("guest room".to_owned())));
        assert_eq!(place("-0.5, 2"), Ok(Place::Plan(DVec2::new(-0.5, 2.0))));
        assert_eq!(place("1,2,-3e-1"), Ok(Place::World(DVec3::new(1.0, 2.0, -0.3))));
        assert_eq!(place("red mug, small"), Ok(Place::Label("red mug, small".to_owned())));
        for wrong in ["", " ", "1,inf", "nan,1", "1,2,3,4", "1.5"] {
            assert!(place(wrong).is_err(), "{wrong:?}");
        }
    }
}
