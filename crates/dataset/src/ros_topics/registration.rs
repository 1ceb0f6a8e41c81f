//! Whether depth is registered to colour already, by the headers of both and the settings.
//!
//! Drivers say it in many ways, and some contradict themselves. Two images of one frame, size and K are those of one
//! camera: their pixels belong together as they are stored, so both are undistorted alike. K of one camera hardly ever is
//! that of another one to a fraction of a pixel, so depth with the size and K of colour is taken as registered even if it
//! names another frame. Ambiguous headers cause one warning, with the setting that decides otherwise.

use super::camera_list::{Cameras, calibrations, image_facts};
use super::choice::Choice;
use super::frames::FrameMaker;
use super::transforms::Rigid;
use crate::own_camera::OwnCamera;
use crate::undistort::Camera;
use crate::{DatasetError, DepthRegistration};
use splatseg_geometry::Pose;
use std::path::Path;

/// Cameras whose pixels are closer than this are the same, pixels: less than the error of nearest neighbours.
const SAME_PIXEL: f64 = 0.5;
/// Frames that are closer are the same place: metres, and radians.
const SAME_PLACE_M: f64 = 1e-3;
const SAME_PLACE_ANGLE: f64 = 2e-3;

/// How depth is brought to the pixels of colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Alignment {
    /// One camera took both, and each camera info describes it.
    SameCamera,
    /// Its pixels are those of the stored colour images: it is undistorted with the colour camera's lens.
    AsColor,
    /// There is none.
    NoDepth,
    /// It is undistorted and then warped from its own camera.
    Registered { color_from_depth: Pose },
}

/// An alignment, and what is ambiguous about it.
#[derive(Clone, Debug)]
pub(super) struct Decision {
    pub(super) alignment: Alignment,
    pub(super) warning: Option<String>,
}

/// The first camera of each of both topics.
struct Pair {
    color: Camera,
    /// The depth camera, by its own topic.
    depth: Camera,
    /// The depth camera, if its images were treated like those of colour.
    depth_alike: Camera,
}

/// Decides how depth is aligned. `own` is the camera of the settings.
///
/// # Errors
/// If depth must be registered, and no fixed transform connects the frames.
pub(super) fn decide(
    maker: &FrameMaker<'_>,
    own: Option<OwnCamera>,
    (color, depth): (&Cameras, &Cameras),
) -> Result<Decision, DatasetError> {
    let certain = |alignment| Ok(Decision { alignment, warning: None });
    match maker.settings.register_depth {
        DepthRegistration::False => return certain(Alignment::AsColor),
        DepthRegistration::True => return certain(registered(maker)?),
        DepthRegistration::Auto => {}
    }
    let choice = &maker.choice;
    let has_same_frame = choice.color.1.frame == choice.depth.1.frame;
    let Some(pair) = pair(choice, own, (color, depth)) else {
        let warning = (!has_same_frame).then(|| {
            format!(
                "no camera info describes {}, whose frame is not that of {}: depth is taken as registered to colour",
                choice.depth.0.name, choice.color.0.name
            )
        });
        return Ok(Decision { alignment: Alignment::AsColor, warning });
    };
    let has_same_k = own.is_some() && has_same_frame || pair.depth_alike.grid_distance(&pair.color) <= SAME_PIXEL;
    let is_same_grid = has_same_k && pair.depth.has_shape_of(&pair.color);
    let transform = if has_same_frame { Some(Rigid::IDENTITY) } else { transform(maker) };
    let is_same_place = transform.is_some_and(|transform| {
        let (distance, angle) = transform.apart(&Rigid::IDENTITY);
        distance < SAME_PLACE_M && angle < SAME_PLACE_ANGLE
    });
    let has_same_size = pair.depth.intrinsics.width == pair.color.intrinsics.width
        && pair.depth.intrinsics.height == pair.color.intrinsics.height;
    let frames = || Some(frames_text(choice, transform.as_ref(), has_same_size));
    match (is_same_grid, is_same_place) {
        (true, true) => Ok(of_one_camera(choice, &pair)),
        (true, false) if has_same_size => Ok(Decision { alignment: Alignment::AsColor, warning: frames() }),
        (true, false) => Ok(Decision { alignment: registered(maker)?, warning: frames() }),
        (false, _) => {
            let warning = (has_same_frame && has_same_size).then(|| other_k_text(choice, &pair));
            Ok(Decision { alignment: registered(maker)?, warning })
        }
    }
}

/// Decides about two images with the frame, size and K of one camera.
fn of_one_camera(choice: &Choice<'_>, pair: &Pair) -> Decision {
    let (color, depth) = (&choice.color.0.name, &choice.depth.0.name);
    let lens = pair.depth_alike.lens_distance(&pair.color);
    if lens > SAME_PIXEL {
        let warning = format!(
            "{color} and {depth} have one frame, size and K, but other lens distortion (D), up to {} apart: depth is \
             taken as registered to the stored colour images, and both are undistorted alike; --register-depth true \
             undistorts each by its own camera info",
            pixels(lens)
        );
        return Decision { alignment: Alignment::AsColor, warning: Some(warning) };
    }
    let apart = pair.depth.lens_distance(&pair.color).max(pair.depth.grid_distance(&pair.color));
    if apart <= SAME_PIXEL {
        return Decision { alignment: Alignment::SameCamera, warning: None };
    }
    // RealSense names the colour of a D405 so, which has no other; its aligned depth is that of these very pixels.
    let is_usual = color.contains("image_rect_raw");
    let warning = (!is_usual).then(|| {
        format!(
            "{color} and {depth} have one frame, size, K and D, but only one of them is named as rectified: depth is taken \
             as registered to the stored colour images, and both are treated alike, though that makes up to {}; \
             --register-depth true treats each by its name",
            pixels(apart)
        )
    });
    Decision { alignment: Alignment::AsColor, warning }
}

fn frames_text(choice: &Choice<'_>, transform: Option<&Rigid>, has_same_size: bool) -> String {
    let ((color, color_images), (depth, depth_images)) = (choice.color, choice.depth);
    let place = match transform {
        Some(transform) => {
            let (distance, angle) = transform.apart(&Rigid::IDENTITY);
            format!("{:.1} cm and {:.1} degrees from", 100.0 * distance, angle.to_degrees())
        }
        None => "not connected to".to_owned(),
    };
    let (alike, consequence) = if has_same_size {
        ("size and K", "depth is taken as registered to colour; if it is not, --register-depth true registers it")
    } else {
        (
            "K, at another size,",
            "depth is registered to colour here; if it is registered already, --register-depth false takes it as it is",
        )
    };
    format!(
        "{} has the {alike} of {}, but its frame, {}, is {place} {} in /tf_static: {consequence}",
        depth.name, color.name, depth_images.frame, color_images.frame
    )
}

fn other_k_text(choice: &Choice<'_>, pair: &Pair) -> String {
    let text = |camera: &Camera| {
        let camera = camera.intrinsics;
        format!("{}, {}, {}, {}", camera.fx, camera.fy, camera.cx, camera.cy)
    };
    format!(
        "{} and {} have one frame and size, but other K (fx, fy, cx, cy: {}; {}), so depth is registered to colour here; \
         if it is registered already, --register-depth false takes it as it is",
        choice.color.0.name,
        choice.depth.0.name,
        text(&pair.color),
        text(&pair.depth)
    )
}

fn pixels(distance: f64) -> String {
    if distance.is_finite() { format!("{distance:.1} pixels") } else { "infinitely many pixels".to_owned() }
}

/// Returns the first cameras, as the camera infos describe them; `None` if nothing describes depth.
fn pair(choice: &Choice<'_>, own: Option<OwnCamera>, (color, depth): (&Cameras, &Cameras)) -> Option<Pair> {
    let place = Path::new("");
    let first = |info: Option<&super::contents::Topic>, facts| {
        let mut cameras = calibrations(info?).iter();
        cameras.find_map(|(_, calibration)| calibration.camera(facts, place).ok())
    };
    let color_facts = image_facts(choice.color, choice.color_info, None);
    let depth_facts = image_facts(choice.depth, choice.depth_info, None);
    let alike = super::cameras::ImageFacts { is_rectified: color_facts.is_rectified, ..depth_facts };
    // Without a usable camera info, the settings describe colour.
    let color_camera = first(choice.color_info, color_facts).or_else(|| {
        own?;
        color.list.first().copied()
    })?;
    let depth_camera = depth.list.first().copied()?;
    let depth_alike = first(choice.depth_info, alike)?;
    Some(Pair { color: color_camera, depth: depth_camera, depth_alike })
}

/// Returns the transform from depth camera to colour camera coordinates, if it is known and constant.
fn transform(maker: &FrameMaker<'_>) -> Option<Rigid> {
    let (color, depth) = (&maker.choice.color.1.frame, &maker.choice.depth.1.frame);
    if color == depth {
        return Some(Rigid::IDENTITY);
    }
    maker.contents.tree.fixed_transform(depth, color)
}

/// Returns the registration from the frame of depth to that of colour.
fn registered(maker: &FrameMaker<'_>) -> Result<Alignment, DatasetError> {
    let Some(transform) = transform(maker) else {
        let (color, depth) = (&maker.choice.color.1.frame, &maker.choice.depth.1.frame);
        let found = format!("depth in frame {depth:?}, colour in frame {color:?}");
        let expected = "a fixed transform between them in /tf_static, or depth that is registered to colour: choose it with \
                        --depth, or say so with --register-depth false";
        return Err(maker.error("frames of the cameras", found, expected.to_owned()));
    };
    maker.warn_of_fixed_contradictions();
    transform
        .to_pose()
        .map(|color_from_depth| Alignment::Registered { color_from_depth })
        .map_err(|source| DatasetError::Pose { path: maker.path.to_owned(), source })
}
