//! Which views of an object are kept: the best, and those that show other surface.

use splatseg_geometry::{CameraFrame, Image, Intrinsics, Pose, RemappedId, SegmentMap};
use splatseg_objects::{BoundingBox, KeptViews, ObjectName, ObjectNames, ObjectSighting, ViewedFrame};

const SIZE: usize = 60;
const CAMERA: Intrinsics = Intrinsics { fx: 50.0, fy: 50.0, cx: 29.5, cy: 29.5, width: SIZE, height: SIZE };

/// A square thing in the middle of an image, a metre before a camera that was moved sideways.
struct Seen {
    id: u32,
    side: usize,
    moved: f64,
    frame: usize,
}

impl Seen {
    fn record(&self, views: &mut KeptViews, has_pose: bool) {
        let first = (SIZE - self.side) / 2;
        let inside = |place: usize| (first..first + self.side).contains(&place);
        let segments: SegmentMap =
            Image::from_fn(SIZE, SIZE, |column, row| if inside(column) && inside(row) { self.id } else { 0 });
        let color = Image::filled(SIZE, SIZE, [self.frame as u8; 3]);
        let frame = CameraFrame::new("0", color, Image::filled(SIZE, SIZE, 1.0), CAMERA).unwrap();
        let mut matrix = Pose::IDENTITY.to_row_major();
        matrix[3] = self.moved;
        let pose = Pose::from_row_major(matrix).unwrap();
        let sighting = ObjectSighting {
            id: self.id,
            area: self.side * self.side,
            bounding_box: BoundingBox { x: first, y: first, width: self.side, height: self.side },
            confidence: 1.0,
            first_frame: 0,
            last_frame: self.frame,
        };
        views.record(&ViewedFrame::new(&frame, &segments, has_pose.then_some(&pose)), &[sighting]);
    }
}

/// The frames whose views are kept, the best first.
fn frames(views: &KeptViews, id: u32) -> Vec<u8> {
    views.views(id).into_iter().map(|(view, _)| view.image[(0, 0)][0]).collect()
}

#[test]
fn other_surface_is_kept_and_the_same_is_not() {
    let mut views = KeptViews::default();
    let mut see = |frame: usize, side: usize, moved: f64, has_pose: bool| {
        Seen { id: 7, side, moved, frame }.record(&mut views, has_pose);
        frames(&views, 7)
    };
    assert_eq!(see(1, 20, 0.0, true), [1]);
    assert_eq!(see(2, 21, 0.01, true), [1], "the same surface, hardly better");
    assert_eq!(see(3, 20, 1.0, true), [1, 3], "beside it");
    assert_eq!(see(4, 6, 2.0, true), [1, 3], "too small to be worth it");
    assert_eq!(see(5, 20, 0.8, false), [1, 3], "nobody knows which surface");
    assert_eq!(see(6, 30, 0.0, true), [6, 3], "clearly better than the first");
    assert_eq!(see(7, 25, 1.0, true), [6, 7], "clearly better than the second");
    assert_eq!(see(8, 30, -2.0, true), [6, 7, 8]);
    assert_eq!(see(9, 30, -4.0, true), [6, 7, 8, 9]);
    assert_eq!(see(10, 30, -6.0, true).len(), KeptViews::MOST, "no room");
}

#[test]
fn objects_are_named_again_when_their_views_have_become_better() {
    let (mut views, mut names) = (KeptViews::default(), ObjectNames::default());
    let named = |views: &KeptViews, names: &mut ObjectNames| {
        let ids: Vec<u32> = views.to_name(names).collect();
        for id in &ids {
            names.set(*id, ObjectName::default(), views.score(*id).unwrap()).unwrap();
        }
        ids
    };
    Seen { id: 1, side: 20, moved: 0.0, frame: 1 }.record(&mut views, true);
    Seen { id: 2, side: 20, moved: 0.0, frame: 1 }.record(&mut views, true);
    assert_eq!(named(&views, &mut names), [1, 2]);
    assert!(named(&views, &mut names).is_empty());
    Seen { id: 1, side: 20, moved: 0.5, frame: 2 }.record(&mut views, true);
    assert_eq!(named(&views, &mut names), [1], "it was seen from another side");

    // Views go with ids that turn out to be the same object.
    Seen { id: 2, side: 22, moved: -0.5, frame: 3 }.record(&mut views, true);
    views.remap(&[RemappedId { from: 2, into: 1 }]);
    assert_eq!(frames(&views, 2), [] as [u8; 0]);
    assert_eq!(frames(&views, 1)[0], 3);
    assert_eq!(frames(&views, 1).len(), 3);
    assert_eq!(views.last_frame(1), Some(3));
    views.forget(1);
    assert_eq!(views.score(1), None);
}

#[test]
fn one_view_is_the_best() {
    let mut views = KeptViews::with_most(1);
    for (frame, moved) in [(1, 0.0), (2, 0.5), (3, 1.0)] {
        Seen { id: 1, side: 20 + 5 * frame, moved, frame }.record(&mut views, true);
    }
    assert_eq!(frames(&views, 1), [3]);
}
