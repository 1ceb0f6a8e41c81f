//! The map from above, with the objects' footprints, ids and names.

use crate::boxes::convex_hull;
use crate::canvas::{Canvas, Rectangle};
use crate::facts::{rounded, solid};
use crate::open_map::LoadedMap;
use crate::tool::{Picture, ToolError};
use glam::{DQuat, DVec2, DVec3};
use rmcp::schemars::{self, JsonSchema};
use serde::Serialize;
use splatseg_geometry::{Image, SegmentId};
use splatseg_objects::Object;
use splatseg_output::segment_color;
use std::collections::{BTreeMap, BTreeSet};

/// Longest side of the picture, pixels.
const MAX_SIDE: f64 = 1000.0;
/// Greatest scale, pixels per metre.
const MAX_SCALE: f64 = 200.0;
/// Around the map, metres.
const MARGIN: f64 = 0.25;
/// Share of the Gaussians that may lie outside the picture on each side.
const OUTLIERS: f64 = 0.005;
/// Height above the lowest part of the map from which things hide the rest, metres: ceilings and lamps.
const CEILING: f64 = 2.0;
/// How much of the map's own colours is left.
const PALE: f64 = 0.45;
/// Footprints with a greater share of the picture are not filled: floors and walls.
const LARGE: f64 = 0.25;
const UNKNOWN_FLOOR: [u8; 3] = [205; 3];
const OCCUPIED_FLOOR: [u8; 3] = [90; 3];
const ROUTE: [u8; 3] = [220, 0, 160];
const LENGTH_OF_BAR: f64 = 1.0;

/// The objects and the area of a plan.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct PlanFacts {
    /// Width and height of the picture, pixels.
    size_px: [usize; 2],
    /// Metres per pixel.
    meters_per_pixel: f64,
    /// The place of the upper left corner at height 0 above the map's origin, map coordinates, metres.
    top_left_m: [f64; 3],
    /// Unit vector in the map's coordinates that points to the right of the picture.
    right: [f64; 3],
    /// Unit vector in the map's coordinates that points down in the picture.
    down: [f64; 3],
    /// The objects that are drawn with a label.
    labelled: Vec<Label>,
    /// Number of objects that are drawn without one, for lack of room.
    without_label: usize,
}

/// A label in the picture.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct Label {
    /// The object.
    id: SegmentId,
    /// Its name.
    name: Option<String>,
    /// Its centre, pixels from the upper left corner.
    center_px: [i64; 2],
}

/// Drawn on top of the map.
#[derive(Debug, Default)]
pub struct Shown<'a> {
    /// Objects to emphasise: only they have labels, unless there are none.
    pub objects: BTreeSet<SegmentId>,
    /// A route, map coordinates, metres.
    pub route: &'a [DVec3],
}

/// How the plan lies in the map.
struct Layout {
    level_from_world: DQuat,
    /// The upper left corner, metres; y points up in the picture.
    corner: DVec2,
    /// Pixels per metre.
    scale: f64,
    size: (usize, usize),
    /// Height of the lowest part of the map, metres.
    low: f64,
}

/// An object's footprint.
struct Footprint<'a> {
    object: &'a Object,
    polygon: Vec<DVec2>,
    center: DVec2,
    area: f64,
}

impl Layout {
    fn new(map: &LoadedMap) -> Result<Self, ToolError> {
        let level_from_world = map.level_from_world();
        let places: Vec<DVec3> = gaussians(map).map(|(place, ..)| level_from_world * place).collect();
        if places.is_empty() {
            return Err(ToolError("The map has no surface with a known place, so there is no plan.".to_owned()));
        }
        let range = |axis: usize, outliers: f64| {
            let mut along: Vec<f64> = places.iter().map(|place| place[axis]).collect();
            along.sort_by(f64::total_cmp);
            let skipped = (outliers * along.len() as f64) as usize;
            (along[skipped], along[along.len() - 1 - skipped])
        };
        let ((left, right), (bottom, top)) = (range(0, OUTLIERS), range(1, OUTLIERS));
        let (width, height) = (right - left + 2.0 * MARGIN, top - bottom + 2.0 * MARGIN);
        let scale = (MAX_SIDE / width.max(height)).min(MAX_SCALE);
        let side = |length: f64| (length * scale).round().clamp(1.0, MAX_SIDE) as usize;
        Ok(Self {
            level_from_world,
            corner: DVec2::new(left - MARGIN, top + MARGIN),
            scale,
            size: (side(width), side(height)),
            low: range(2, 0.02).0,
        })
    }

    /// The pixel of a place of the map.
    fn pixel(&self, world: DVec3) -> DVec2 {
        let level = self.level_from_world * world;
        DVec2::new(level.x - self.corner.x, self.corner.y - level.y) * self.scale
    }

    /// Height of a place above the lowest part of the map, metres.
    fn height(&self, world: DVec3) -> f64 {
        (self.level_from_world * world).z - self.low
    }

    /// The place below the centre of a pixel, at the height of the lowest part of the map.
    fn place(&self, column: usize, row: usize) -> DVec3 {
        let x = self.corner.x + (column as f64 + 0.5) / self.scale;
        let y = self.corner.y - (row as f64 + 0.5) / self.scale;
        self.level_from_world.inverse() * DVec3::new(x, y, self.low)
    }
}

/// Draws the map from above.
pub fn draw(map: &LoadedMap, shown: &Shown<'_>) -> Result<(Picture, PlanFacts), ToolError> {
    let layout = Layout::new(map)?;
    let mut canvas = Canvas::new(ground(map, &layout));
    let mut footprints: Vec<Footprint<'_>> = footprints(map, &layout, shown);
    let whole = (layout.size.0 * layout.size.1) as f64;
    for footprint in &footprints {
        let color = segment_color(footprint.object.id);
        let is_shown = shown.objects.contains(&footprint.object.id);
        if footprint.area < LARGE * whole {
            canvas.fill(&footprint.polygon, color, if is_shown { 0.7 } else { 0.3 });
        }
        canvas.outline(&footprint.polygon, color, if is_shown { 3 } else { 1 });
    }
    for part in shown.route.windows(2) {
        canvas.line(layout.pixel(part[0]), layout.pixel(part[1]), ROUTE, 4);
    }
    let bar = draw_bar(&mut canvas, &layout);
    // The emphasised ones first, then those with a name, then the largest.
    footprints.sort_by(|one, other| {
        let rank = |footprint: &Footprint<'_>| {
            (!shown.objects.contains(&footprint.object.id), footprint.object.label.is_none())
        };
        rank(one).cmp(&rank(other)).then(other.area.total_cmp(&one.area))
    });
    let to_label = footprints.iter().filter(|one| shown.objects.is_empty() || shown.objects.contains(&one.object.id));
    let (labelled, without_label) = draw_labels(&mut canvas, to_label, bar);
    let world = |level: DVec3| layout.level_from_world.inverse() * level;
    let facts = PlanFacts {
        size_px: [layout.size.0, layout.size.1],
        meters_per_pixel: 1.0 / layout.scale,
        top_left_m: rounded(world(layout.corner.extend(0.0))),
        right: rounded(world(DVec3::X)),
        down: rounded(world(DVec3::NEG_Y)),
        labelled,
        without_label,
    };
    Ok((canvas.png()?, facts))
}

/// Place, radius and colour of each Gaussian with a place, world coordinates, metres.
fn gaussians(map: &LoadedMap) -> impl Iterator<Item = (DVec3, f32, [u8; 3])> {
    let view = map.map.memory.map();
    let places = view.means.iter().zip(view.radii).zip(view.colors).zip(view.surfaces);
    places
        .filter(|(_, surface)| surface.has_place())
        .map(move |(((mean, radius), color), _)| (mean.as_dvec3() + view.origin, *radius, *color))
}

/// Where the Gaussians of each object are, world coordinates, metres.
fn points_of_objects(map: &LoadedMap) -> BTreeMap<SegmentId, Vec<DVec3>> {
    let view = map.map.memory.map();
    let mut points: BTreeMap<SegmentId, Vec<DVec3>> = BTreeMap::new();
    for ((mean, surface), id) in view.means.iter().zip(view.surfaces).zip(view.segment_ids()) {
        if surface.has_place() {
            points.entry(id).or_default().push(mean.as_dvec3() + view.origin);
        }
    }
    points
}

/// The ground of the picture: what one sees from above without ceiling, pale; free space where it is known.
fn ground(map: &LoadedMap, layout: &Layout) -> Image<[u8; 3]> {
    let (width, height) = layout.size;
    let mut image = Image::filled(width, height, [255; 3]);
    let mut heights = Image::filled(width, height, f64::NEG_INFINITY);
    for (place, radius, color) in gaussians(map) {
        let above = layout.height(place);
        if above > CEILING {
            continue;
        }
        let (center, reach) = (layout.pixel(place), (f64::from(radius) * layout.scale).clamp(0.5, 20.0));
        let range = |center: f64, side: usize| {
            let end = (center + reach).ceil().clamp(0.0, side as f64) as usize;
            (center - reach).floor().clamp(0.0, side as f64) as usize..end
        };
        for row in range(center.y, height) {
            for column in range(center.x, width) {
                if above > heights[(column, row)] {
                    heights[(column, row)] = above;
                    image[(column, row)] = color.map(|channel| (255.0 - PALE * (255.0 - f64::from(channel))) as u8);
                }
            }
        }
    }
    if let Ok(places) = &map.places {
        for row in 0..height {
            for column in 0..width {
                match places.is_free(layout.place(column, row)) {
                    Some(true) => image[(column, row)] = [255; 3],
                    Some(false) if heights[(column, row)].is_finite() => {}
                    Some(false) => image[(column, row)] = OCCUPIED_FLOOR,
                    None => image[(column, row)] = UNKNOWN_FLOOR,
                }
            }
        }
    }
    image
}

/// The footprints of the objects that count, the largest first. What hangs above the ceiling is left out.
fn footprints<'a>(map: &'a LoadedMap, layout: &Layout, shown: &Shown<'_>) -> Vec<Footprint<'a>> {
    let points = points_of_objects(map);
    let footprint = |object: &'a Object| {
        let solid = solid(object)?;
        // Stray points of an object are outside its box.
        let own: Vec<DVec3> =
            points.get(&object.id).into_iter().flatten().copied().filter(|at| solid.has(*at)).collect();
        let is_low = own.iter().any(|point| layout.height(*point) < CEILING);
        let polygon = convex_hull(own.iter().map(|point| layout.pixel(*point)).collect());
        let area = 0.5 * (0..polygon.len()).map(|i| polygon[i].perp_dot(polygon[(i + 1) % polygon.len()])).sum::<f64>();
        let center = layout.pixel(solid.center());
        (is_low || shown.objects.contains(&object.id)).then_some(Footprint {
            object,
            polygon,
            center,
            area: area.abs(),
        })
    };
    let also = map.list.not_counted.iter().filter(|object| shown.objects.contains(&object.id));
    let mut footprints: Vec<Footprint<'_>> = map.list.objects.iter().chain(also).filter_map(footprint).collect();
    footprints.sort_by(|one, other| other.area.total_cmp(&one.area).then(one.object.id.cmp(&other.object.id)));
    footprints
}

/// Draws a bar of one metre, and returns where it stands.
fn draw_bar(canvas: &mut Canvas, layout: &Layout) -> Rectangle {
    let bottom = canvas.size().1 as f64 - 8.0;
    let (from, to) = (DVec2::new(8.0, bottom), DVec2::new(8.0 + LENGTH_OF_BAR * layout.scale, bottom));
    canvas.line(from, to, [0; 3], 3);
    let at = Canvas::text_rectangle(DVec2::new(56.0, bottom - 14.0), "1 metre", 2);
    canvas.text(at, "1 metre", 2);
    let Rectangle([left, top, right, _]) = at;
    Rectangle([left, top, right.max(to.x as i64), canvas.size().1 as i64])
}

/// Draws labels where there is room: id and name, or the id alone. Returns them, and how many had no room.
fn draw_labels<'a, 'b: 'a>(
    canvas: &mut Canvas,
    footprints: impl Iterator<Item = &'a Footprint<'b>>,
    bar: Rectangle,
) -> (Vec<Label>, usize) {
    let (mut taken, mut labels, mut without) = (vec![bar], Vec::new(), 0);
    let (width, height) = canvas.size();
    let inside = |at: &Rectangle| at.0[0] >= 0 && at.0[1] >= 0 && at.0[2] <= width as i64 && at.0[3] <= height as i64;
    for Footprint { object, center, .. } in footprints {
        let whole = object.label.as_ref().map(|label| format!("{} {label}", object.id));
        let texts =
            whole.into_iter().map(|text| (text, 2)).chain([(object.id.to_string(), 2), (object.id.to_string(), 1)]);
        let place = texts.map(|(text, dot)| (Canvas::text_rectangle(*center, &text, dot), text, dot));
        let mut place = place.filter(|(at, ..)| inside(at) && !taken.iter().any(|other| other.overlaps(at)));
        let Some((at, text, dot)) = place.next() else {
            without += 1;
            continue;
        };
        drop(place);
        canvas.text(at, &text, dot);
        taken.push(at);
        let center_px = [center.x.round() as i64, center.y.round() as i64];
        labels.push(Label { id: object.id, name: object.label.clone(), center_px });
    }
    (labels, without)
}

impl PlanFacts {
    /// Describes the picture in words.
    pub fn words(&self, map: &LoadedMap) -> String {
        let [right, down] = [self.right, self.down].map(|[x, y, z]| format!("[{x:.2}, {y:.2}, {z:.2}]"));
        let mut text = format!(
            "The map from above, {:.1} x {:.1} m; the bar is 1 m long. In the map's coordinates the picture's right is {right} \
             and its down {down}. Labels are ids, with names where there is room:",
            self.size_px[0] as f64 * self.meters_per_pixel,
            self.size_px[1] as f64 * self.meters_per_pixel
        );
        let names = self.labelled.iter().filter_map(|label| map.object(label.id)).map(|object| match &object.label {
            Some(label) => format!("{} {label}", object.id),
            None => object.id.to_string(),
        });
        text += &format!(" {}.", names.collect::<Vec<_>>().join(", "));
        if self.without_label > 0 {
            text += &format!(" {} more objects are drawn without a label.", self.without_label);
        }
        if let Err(problem) = &map.places {
            text += &format!(" Not shown: {problem}.");
        }
        text
    }
}
