//! Things seen from all around, under a lamp and behind a post, are named by a tiny network from their largest view alone,
//! and from several views that show other surface.

use crate::tiny_clip::{COLORS, SHAPES, write_network, write_vocabulary};
use glam::{DMat3, DMat4, DVec3, Vec2};
use splatseg::geometry::{CameraFrame, Image, Intrinsics, Pose, SegmentMap};
use splatseg::names::ClipNames;
use splatseg::objects::{BoundingBox, KeptViews, ObjectSighting, ViewedFrame};
use std::path::Path;

const CAMERA: Intrinsics = Intrinsics { fx: 150.0, fy: 150.0, cx: 63.5, cy: 47.5, width: 128, height: 96 };
const FRAMES: usize = 14;
const ROUNDS: u64 = 5;
const RADIUS: f64 = 0.15;
const THING: u32 = 1;
const ELSE: u32 = 2;

/// A generator of numbers from 0 to 1 (SplitMix64).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((mixed ^ (mixed >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// A thing on a floor, with a lamp beside it and a post before it.
struct Room {
    shape: &'static str,
    color: [u8; 3],
    lamp: DVec3,
    post: DVec3,
    backdrop: f64,
    /// From where the camera comes nearest, and how near that is.
    nearest: (f64, f64),
}

impl Room {
    fn new(shape: &'static str, color: [u8; 3], random: &mut Random) -> Self {
        let mut turn = || random.next() * std::f64::consts::TAU;
        let (lamp, post, nearest) = (turn(), turn(), turn());
        Self {
            shape,
            color,
            lamp: DVec3::new(lamp.cos(), lamp.sin(), 0.3).normalize(),
            post: 0.3 * DVec3::new(post.cos(), post.sin(), 0.0),
            backdrop: 60.0 + 140.0 * random.next(),
            nearest: (nearest, 0.5 + 0.3 * random.next()),
        }
    }

    /// Where a ray meets the thing: the distance and the normal.
    fn thing(&self, from: DVec3, way: DVec3) -> Option<(f64, DVec3)> {
        let least = |hits: Vec<(f64, DVec3)>| hits.into_iter().min_by(|one, other| one.0.total_cmp(&other.0));
        match self.shape {
            "ball" => {
                let (half, rest) = (from.dot(way), from.length_squared() - RADIUS * RADIUS);
                let root = half * half - rest;
                let distance = -half - root.max(0.0).sqrt();
                (root > 0.0).then(|| (distance, (from + distance * way) / RADIUS))
            }
            "box" => {
                let side = 0.8 * RADIUS;
                let hits = (0..6).filter_map(|face| {
                    let (axis, sign) = (face / 2, if face % 2 == 0 { 1.0 } else { -1.0 });
                    let mut normal = DVec3::ZERO;
                    normal[axis] = sign;
                    let distance = (side - from.dot(normal)) / way.dot(normal);
                    let point = from + distance * way;
                    let inside = (0..3).all(|other| other == axis || point[other].abs() <= side);
                    (way.dot(normal) < 0.0 && inside).then_some((distance, normal))
                });
                least(hits.collect())
            }
            _ => {
                // A cone of the height of two radii: its radius falls from the floor to the top.
                let slope = 0.5;
                let (top, base) = (DVec3::new(0.0, 0.0, RADIUS), slope * slope);
                let start = from - top;
                let a = way.x * way.x + way.y * way.y - base * way.z * way.z;
                let b = start.x * way.x + start.y * way.y - base * start.z * way.z;
                let c = start.x * start.x + start.y * start.y - base * start.z * start.z;
                let root = (b * b - a * c).max(0.0).sqrt();
                let hits = [(-b - root) / a, (-b + root) / a].into_iter().filter_map(|distance| {
                    let point = start + distance * way;
                    let normal = DVec3::new(point.x, point.y, -base * point.z).normalize();
                    let inside = (-2.0 * RADIUS..=0.0).contains(&point.z);
                    (b * b > a * c && distance > 0.0 && inside).then_some((distance, normal))
                });
                least(hits.collect())
            }
        }
    }

    /// Where a ray meets the post.
    fn post(&self, from: DVec3, way: DVec3) -> Option<f64> {
        let start = (from - self.post).with_z(0.0);
        let flat = way.with_z(0.0);
        let (a, b, c) = (flat.length_squared(), start.dot(flat), start.length_squared() - 0.04f64.powi(2));
        (b * b > a * c).then(|| (-b - (b * b - a * c).sqrt()) / a).filter(|distance| *distance > 0.0)
    }

    /// Colour, id and distance of what a ray meets.
    fn look(&self, from: DVec3, way: DVec3) -> ([u8; 3], u32, f64) {
        let thing = self.thing(from, way);
        let post = self.post(from, way).filter(|post| thing.is_none_or(|(thing, _)| *post < thing));
        match (thing, post) {
            (_, Some(distance)) => ([90, 85, 80], ELSE, distance),
            (Some((distance, normal)), None) => {
                let light = 0.25 + 0.75 * normal.dot(self.lamp).max(0.0);
                (self.color.map(|channel| (f64::from(channel) * light) as u8), THING, distance)
            }
            (None, None) => {
                let floor = (-RADIUS - from.z) / way.z;
                let (distance, level) =
                    if floor > 0.0 && floor < 2.5 { (floor, 0.8 * self.backdrop) } else { (2.5, self.backdrop) };
                ([level as u8, (0.97 * level) as u8, (0.92 * level) as u8], ELSE, distance)
            }
        }
    }

    /// A frame from a place on the way around the thing, with its ids.
    fn frame(&self, number: usize) -> (CameraFrame<'static>, SegmentMap, Pose) {
        let turn = std::f64::consts::TAU * number as f64 / FRAMES as f64;
        let away = 0.5 * (1.0 - (turn - self.nearest.0).cos());
        let place = (self.nearest.1 + 0.5 * away) * DVec3::new(turn.cos(), turn.sin(), 0.0) + DVec3::new(0.0, 0.0, 0.2);
        let forward = -place.normalize();
        let right = forward.cross(DVec3::Z).normalize();
        let rotation = DMat3::from_cols(right, forward.cross(right), forward);
        let mut matrix = DMat4::from_mat3(rotation);
        matrix.w_axis = place.extend(1.0);
        let seen = Image::from_fn(CAMERA.width, CAMERA.height, |column, row| {
            let way = CAMERA.unproject(Vec2::new(column as f32, row as f32), 1.0).as_dvec3();
            let (color, id, distance) = self.look(place, (rotation * way).normalize());
            (color, id, (distance / way.length()) as f32)
        });
        let frame =
            CameraFrame::new(number.to_string(), seen.map(|seen| seen.0), seen.map(|seen| seen.2), CAMERA).unwrap();
        (frame, seen.map(|seen| seen.1), Pose::from_matrix(matrix).unwrap())
    }
}

/// The sighting of the thing in an image of ids; `None` if it is hidden.
fn sighting(ids: &SegmentMap, number: usize) -> Option<ObjectSighting> {
    let shown: Vec<(usize, usize)> = (0..ids.height())
        .flat_map(|row| (0..ids.width()).map(move |column| (column, row)))
        .filter(|place| ids[*place] == THING)
        .collect();
    let range = |values: Vec<usize>| (*values.iter().min().unwrap(), *values.iter().max().unwrap());
    (!shown.is_empty()).then(|| {
        let (left, right) = range(shown.iter().map(|place| place.0).collect());
        let (top, bottom) = range(shown.iter().map(|place| place.1).collect());
        let bounding_box = BoundingBox { x: left, y: top, width: right + 1 - left, height: bottom + 1 - top };
        ObjectSighting {
            id: THING,
            area: shown.len(),
            bounding_box,
            confidence: 1.0,
            first_frame: 0,
            last_frame: number,
        }
    })
}

/// The things with the embedding of each, for each maximum number of views.
fn embedded<const N: usize>(network: &ClipNames, most: [usize; N]) -> ([Vec<Vec<f32>>; N], Vec<String>, usize) {
    let (mut random, mut embeddings, mut right) = (Random(3), [(); N].map(|()| Vec::new()), Vec::new());
    let mut views = 0;
    for _ in 0..ROUNDS {
        for shape in SHAPES {
            for (name, color) in COLORS {
                let room = Room::new(shape, color, &mut random);
                let mut kept = most.map(KeptViews::with_most);
                for number in 0..FRAMES {
                    let (frame, ids, pose) = room.frame(number);
                    let Some(sighting) = sighting(&ids, number) else { continue };
                    for kept in &mut kept {
                        kept.record(&ViewedFrame::new(&frame, &ids, Some(&pose)), &[sighting]);
                    }
                }
                for (embeddings, kept) in embeddings.iter_mut().zip(&kept) {
                    embeddings.push(network.embed_views(&kept.views(THING)).unwrap());
                }
                views += kept[N - 1].views(THING).len();
                right.push(format!("{name} {shape}"));
            }
        }
    }
    (embeddings, right, views)
}

/// A network whose labels are those of all shapes but some.
fn network(folder: &Path, without: &[&str]) -> ClipNames {
    let (weights, vocabulary) = (folder.join("tiny.safetensors"), folder.join("things.txt"));
    write_network(&weights);
    write_vocabulary(&vocabulary, without);
    ClipNames::open(&weights, Some(&vocabulary)).unwrap()
}

fn labels(network: &ClipNames, embeddings: &[Vec<f32>]) -> Vec<Option<String>> {
    let embeddings: Vec<&[f32]> = embeddings.iter().map(Vec::as_slice).collect();
    network.choose_labels(&embeddings).unwrap().into_iter().map(|name| name.label).collect()
}

#[test]
fn several_views_by_surface_name_more_things_than_the_largest_alone() {
    let folder = tempfile::tempdir().unwrap();
    let network = network(folder.path(), &[]);
    let most = [1, 2, 3, KeptViews::MOST];
    let (embeddings, right, views) = embedded(&network, most);
    let counts = embeddings.map(|embeddings| {
        let labels = labels(&network, &embeddings);
        let found = labels.iter().zip(&right).filter(|(label, right)| label.as_ref() == Some(*right)).count();
        (found, labels.iter().flatten().count())
    });
    let all = right.len();
    let mean = views as f64 / all as f64;
    println!("right, and named, of {all} from at most {most:?} views: {counts:?}; {mean:.1} views each");
    assert!(counts[3].0 > counts[0].0, "{counts:?}");
}

#[test]
fn what_is_not_in_the_vocabulary_mostly_stays_unknown() {
    let folder = tempfile::tempdir().unwrap();
    let network = network(folder.path(), &["cone"]);
    let ([embeddings], right, _) = embedded(&network, [KeptViews::MOST]);
    let is_cone = |right: &str| right.ends_with("cone");
    let cones = right.iter().filter(|right| is_cone(right)).count();
    let mut network = network;
    let mut counts = Vec::new();
    for min_score in [ClipNames::MIN_SCORE, 0.3, 0.5, 0.7, 0.9] {
        network = network.with_min_score(min_score);
        let labels = labels(&network, &embeddings);
        let count = |wanted: &dyn Fn(&str, Option<&str>) -> bool| {
            right.iter().zip(&labels).filter(|(right, label)| wanted(right.as_str(), label.as_deref())).count()
        };
        let named = count(&|right, label| is_cone(right) && label.is_some());
        let withheld = count(&|right, label| !is_cone(right) && label.is_none());
        counts.push((min_score, named, withheld));
    }
    println!(
        "of {cones} unknown things got a name, of {} known ones none, by the least score: {counts:?}",
        right.len() - cones
    );
}
