//! `what_is_near`: the objects around an object or a place.

use crate::Assistant;
use crate::boxes::SolidBox;
use crate::facts::{place, solid, thousandths};
use crate::object_reference::ObjectReference;
use crate::open_map::LoadedMap;
use crate::tool::{Answer, Tool, ToolError};
use glam::DVec3;
use rmcp::schemars::{self, JsonSchema};
use serde::{Deserialize, Serialize};
use splatseg_geometry::SegmentId;

const DEFAULT_RADIUS: f64 = 1.0;
const MAX_RADIUS: f64 = 1000.0;
const DEFAULT_LIMIT: usize = 20;
const MAX_LIMIT: usize = 100;
/// An object is above another one if it begins at most this much below its top, metres; likewise below.
const OVERLAP: f64 = 0.03;
/// Coordinates of a place may be this large, metres.
const FARTHEST: f64 = 1e7;

/// The arguments of `what_is_near`.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Input {
    /// The object in the middle; or give a point.
    object: Option<ObjectReference>,
    /// A place in the map's coordinates, metres, instead of an object.
    point: Option<[f64; 3]>,
    /// How far to look, metres, from surface to surface; 1 if not given.
    radius_m: Option<f64>,
    /// Maximum number of objects, 1 to 100; 20 if not given.
    #[schemars(range(min = 1, max = 100))]
    limit: Option<usize>,
}

/// The answer of `what_is_near`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Output {
    /// The object in the middle; null for a point.
    object: Option<SegmentId>,
    /// The objects within the radius, the nearest first.
    near: Vec<NearObject>,
    /// Number of objects within the radius, with those beyond the limit.
    total: usize,
}

/// An object near another one or a place.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct NearObject {
    /// Its id.
    id: SegmentId,
    /// Its name; null if nobody has named it.
    name: Option<String>,
    /// Distance between the two boxes, metres; 0 if they touch or overlap.
    distance_m: f64,
    /// above, below or beside the object or place in the middle.
    side: &'static str,
    /// From the middle to its centre, metres.
    offset_m: [f64; 3],
}

impl NearObject {
    /// E.g. `table (3), 0.02 m away, below it`.
    pub fn words(&self) -> String {
        let name =
            self.name.as_ref().map_or_else(|| format!("object {}", self.id), |name| format!("{name} ({})", self.id));
        format!("{name}, {:.2} m away, {} it", self.distance_m, self.side)
    }
}

/// The objects that count within a radius of a box, the nearest first.
pub fn near(map: &LoadedMap, middle: &SolidBox, radius: f64, except: Option<SegmentId>) -> Vec<NearObject> {
    let (low, high) = middle.extent(map.up);
    let center = middle.center();
    let others = map.list.objects.iter().filter(|object| Some(object.id) != except);
    let mut near: Vec<NearObject> = others
        .filter_map(|object| {
            let own = solid(object)?;
            let distance = own.distance(middle);
            let (own_low, own_high) = own.extent(map.up);
            let side = match () {
                () if own_low >= high - OVERLAP => "above",
                () if own_high <= low + OVERLAP => "below",
                () => "beside",
            };
            let offset_m = (own.center() - center).to_array().map(thousandths);
            let (id, name) = (object.id, object.label.clone());
            (distance <= radius).then_some(NearObject { id, name, distance_m: thousandths(distance), side, offset_m })
        })
        .collect();
    // Of several that touch it, the one whose centre is nearest.
    let apart = |object: &NearObject| DVec3::from(object.offset_m).length();
    near.sort_by(|one, other| {
        let by_center = apart(one).total_cmp(&apart(other));
        one.distance_m.total_cmp(&other.distance_m).then(by_center).then(one.id.cmp(&other.id))
    });
    near
}

/// The tool.
pub enum WhatIsNear {}

impl Tool for WhatIsNear {
    type Input = Input;
    type Output = Output;
    const NAME: &'static str = "what_is_near";
    const TITLE: &'static str = "What is near";
    const DESCRIPTION: &'static str = "Lists the objects around an object or a point, the nearest first, with distances \
                                       between their boxes and whether each is above, below or beside.";

    fn call(input: Input, assistant: &mut Assistant) -> Result<Answer<Output>, ToolError> {
        let limit = input.limit.unwrap_or(DEFAULT_LIMIT);
        let radius = input.radius_m.unwrap_or(DEFAULT_RADIUS);
        if !(1..=MAX_LIMIT).contains(&limit) {
            return Err(ToolError(format!("limit: found {limit}, expected 1 to {MAX_LIMIT}.")));
        }
        if !(0.0..=MAX_RADIUS).contains(&radius) {
            return Err(ToolError(format!("radius_m: found {radius}, expected 0 to {MAX_RADIUS}.")));
        }
        let (id, middle, called) = match (&input.object, input.point) {
            (Some(object), None) => {
                let id = assistant.meant(object)?;
                (Some(id), assistant.solid(id)?, assistant.called(id))
            }
            (None, Some(point)) => (None, point_box(point)?, place(point)),
            _ => return Err(ToolError("Give either object or point.".to_owned())),
        };
        let near = near(assistant.map.current(), &middle, radius, id);
        let total = near.len();
        let near: Vec<NearObject> = near.into_iter().take(limit).collect();
        let mut text = format!("{} of {total} objects within {radius} m of {called}", near.len());
        near.iter().for_each(|object| text += &format!("\n{}", object.words()));
        Ok(Answer { text, data: Output { object: id, near, total }, picture: None })
    }
}

/// A place of a client.
pub fn point_box(point: [f64; 3]) -> Result<SolidBox, ToolError> {
    if point.iter().any(|coordinate| !coordinate.is_finite() || coordinate.abs() > FARTHEST) {
        return Err(ToolError(format!(
            "point: found {point:?}, expected three numbers from -{FARTHEST} to {FARTHEST}."
        )));
    }
    Ok(SolidBox::point(DVec3::from(point)))
}

impl Assistant {
    /// The box of an object.
    pub(crate) fn solid(&mut self, id: SegmentId) -> Result<SolidBox, ToolError> {
        let solid = self.map.current().object(id).and_then(solid);
        solid.ok_or_else(|| ToolError(format!("Object {id} never had depth, so its place is not known.")))
    }
}
