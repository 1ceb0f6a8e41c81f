//! The memory as seen by one frame's camera.

use crate::removal::{FrameTrust, Visibility, VisibleBalls, visibilities};
use crate::replaced::SeenGaussian;
use crate::settings::COVERED;
use crate::tile_surface::TileSurface;
use crate::{MemoryRules, MemorySettings, SegmentBelief};
use rayon::prelude::*;
use splatseg_geometry::{Image, LocalPose, Pose, RgbdFrame, SegmentId, SegmentMap};
use splatseg_render::{Balls, Camera, TileWeights, View};

/// Pixels of a tile.
const PIXELS: usize = TileWeights::PIXELS;

/// The view of a frame that the memory expects, created by [`SplatMemory::recall`](crate::SplatMemory::recall) before
/// the frame is learnt.
#[derive(Debug)]
pub struct Recall<'f> {
    pub(crate) frame: &'f RgbdFrame<'f>,
    pub(crate) view: View,
    /// The frame's pose in the coordinates of the map.
    pub(crate) map_from_camera: LocalPose,
    /// Pose that the view was rendered from. It differs from `map_from_camera` if the poses have jumped and the map has
    /// not yet followed.
    pub(crate) viewed_from: LocalPose,
    /// Transform from the world of earlier poses to the world of the frame's pose, if they differ.
    pub(crate) jump: Option<Pose>,
    /// True if the frame sees through more than half of the Gaussians that it sees or sees through.
    pub(crate) contradicts_map: bool,
    /// True if the ids of the previous frame are expected where the map shows none.
    pub(crate) links_previous: bool,
    /// How the frame sees every Gaussian; empty where no rule needs it.
    pub(crate) visibility: Vec<Visibility>,
    /// Gaussians that the frame sees, and those that become another thing's in this frame; see
    /// [`SplatMemory::find_replacements`](crate::SplatMemory::find_replacements).
    pub(crate) seen: Vec<SeenGaussian>,
    pub(crate) replaced: Vec<SeenGaussian>,
    pub(crate) belief: SegmentBelief,
    /// Rendered silhouette (accumulated alpha) in [0, 1], `[height, width]`.
    pub(crate) silhouette: Image<f32>,
    /// Rendered z-depth in metres, divided by the silhouette, `[height, width]`; 0 where the map shows nothing.
    pub(crate) depth: Image<f32>,
    /// Accumulated alpha up to the frame's own surface in [0, 1], `[height, width]`: near 0 where the map lacks the
    /// surface. Where the frame has no depth, all alpha counts.
    pub(crate) covered: Image<f32>,
    pub(crate) tiles: Vec<StoreTile>,
}

/// Surfaces that are farther away are no surfaces: what has no depth is assumed to be there.
const MAX_SURFACE_DEPTH: f32 = 25.0;

/// The depth that a map shows, see [`SplatMemory::expected_depth`](crate::SplatMemory::expected_depth).
pub(crate) fn expected_depth(map: &Balls, camera: &Camera, settings: &MemorySettings) -> Image<f32> {
    let (width, height) = (camera.intrinsics.width, camera.intrinsics.height);
    let unknown = Image::filled(width, height, 0.0);
    let (view, tiles) =
        View::read_once(&VisibleBalls::new(map, &[]), camera, |tile| TileSurface::read(tile, &unknown, settings));
    let mut depth = Image::filled(width, height, 0.0);
    for (tile, surface) in view.weights().tiles().iter().zip(tiles) {
        let ((left, top), (width, height)) = (tile.origin(), tile.size());
        for row in 0..height {
            for column in 0..width {
                let at = row * TileWeights::SIDE + column;
                let is_surface = surface.silhouette[at] >= COVERED && surface.depth[at] <= MAX_SURFACE_DEPTH;
                depth[(left + column, top + row)] = if is_surface { surface.depth[at] } else { 0.0 };
            }
        }
    }
    depth
}

/// Where a frame was taken, in the coordinates of the map.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FramePlace {
    /// The frame's pose.
    pub map_from_camera: LocalPose,
    /// Pose that the view is rendered from.
    pub viewed_from: LocalPose,
    /// Transform from the world of earlier poses to the world of the frame's pose, if they differ.
    pub jump: Option<Pose>,
}

/// Use of the blend weights of a view.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum UseOfWeights {
    /// The frame is learnt with them: they are kept.
    Learning,
    /// Only the view is read.
    Reading,
}

/// The segments that a store reads from one tile of a view. Buffers are `[16, 16]`, row-major.
#[derive(Clone, Debug, Default)]
pub struct StoreTile {
    /// Expected segment at every pixel, 0 for none.
    pub segments: Vec<SegmentId>,
    /// Confidence of the expected segment; a fresh observation has 1.
    pub confidence: Vec<f32>,
    /// Ids that `values` refer to, for stores that need them.
    pub ids: Vec<SegmentId>,
    /// The store's own data for the rest of the frame.
    pub values: Vec<f32>,
}

impl<'f> Recall<'f> {
    /// Renders `map` with the camera of `frame` at its place and reads the expected segments of each tile with `read_tile`.
    ///
    /// Gaussians that the frame sees through are left out. Gaussians within the tolerance behind the frame's surface
    /// count as that surface.
    pub(crate) fn new(
        map: &Balls,
        read_tile: impl Fn(&TileWeights, &TileSurface) -> StoreTile + Sync,
        frame: &'f RgbdFrame,
        place: &FramePlace,
        trust: FrameTrust,
        use_of_weights: UseOfWeights,
        (settings, rules): (&MemorySettings, &MemoryRules),
    ) -> Self {
        let camera = &Camera { limits: rules.limits, ..Camera::new(*frame.intrinsics(), &place.viewed_from) };
        let is_papers_map = rules.is_papers_map();
        let needs_visibility = !is_papers_map || rules.compares_frames;
        let (visibility, contradicts_map) = match needs_visibility {
            true => visibilities(map, frame, camera, trust, settings),
            false => (Vec::new(), false),
        };
        let forgets = !is_papers_map && settings.removal_frames > 0;
        let visible = VisibleBalls::new(map, if forgets { &visibility } else { &[] });
        let read_tile = |tile: &TileWeights| {
            let surface = TileSurface::read(tile, frame.depth(), settings);
            (read_tile(tile, &surface), surface)
        };
        let (view, tiles) = match use_of_weights {
            UseOfWeights::Learning => View::read(&visible, camera, read_tile),
            UseOfWeights::Reading => View::read_once(&visible, camera, read_tile),
        };
        let (width, height) = (frame.width(), frame.height());
        let mut recall = Self {
            frame,
            view,
            map_from_camera: place.map_from_camera,
            viewed_from: place.viewed_from,
            jump: place.jump,
            contradicts_map,
            links_previous: false,
            visibility,
            seen: Vec::new(),
            replaced: Vec::new(),
            belief: SegmentBelief::empty(width, height),
            silhouette: Image::filled(width, height, 0.0),
            depth: Image::filled(width, height, 0.0),
            covered: Image::filled(width, height, 0.0),
            tiles: Vec::with_capacity(tiles.len()),
        };
        for (index, (found, surface)) in tiles.into_iter().enumerate() {
            recall.put(index, &found, &surface);
            recall.tiles.push(StoreTile { segments: Vec::new(), confidence: Vec::new(), ..found });
        }
        recall
    }

    /// Expects the ids of the previous frame, `[height, width]`, 0 for none, at pixels where the map expects none.
    pub(crate) fn expecting_previous(mut self, ids: &SegmentMap) -> Self {
        self.links_previous = true;
        let belief = self.belief.segments.pixels_mut().iter_mut().zip(self.belief.confidence.pixels_mut());
        for ((segment, confidence), id) in belief.zip(ids.pixels()) {
            if *segment == 0 && *id != 0 {
                *segment = *id;
                *confidence = 1.0;
            }
        }
        self
    }

    /// Sets the frame's pose in the coordinates that the map is moved to.
    pub(crate) fn moved_to(&mut self, map_from_camera: LocalPose) {
        let limits = self.view.camera().limits;
        self.view.set_camera(Camera { limits, ..Camera::new(*self.frame.intrinsics(), &map_from_camera) });
        self.map_from_camera = map_from_camera;
        self.viewed_from = map_from_camera;
    }

    fn put(&mut self, index: usize, found: &StoreTile, surface: &TileSurface) {
        let tile = &self.view.weights().tiles()[index];
        let ((left, top), (width, height)) = (tile.origin(), tile.size());
        for row in 0..height {
            let from = row * TileWeights::SIDE..row * TileWeights::SIDE + width;
            let start = (top + row) * self.frame.width() + left;
            let to = start..start + width;
            self.belief.segments.pixels_mut()[to.clone()].copy_from_slice(&found.segments[from.clone()]);
            self.belief.confidence.pixels_mut()[to.clone()].copy_from_slice(&found.confidence[from.clone()]);
            self.silhouette.pixels_mut()[to.clone()].copy_from_slice(&surface.silhouette[from.clone()]);
            self.depth.pixels_mut()[to.clone()].copy_from_slice(&surface.depth[from.clone()]);
            self.covered.pixels_mut()[to].copy_from_slice(&surface.covered[from]);
        }
    }

    /// The segments that the memory expects, with confidences.
    pub fn expected(&self) -> &SegmentBelief {
        &self.belief
    }

    /// True where the map knows what the frame shows, `[height, width]`: it expects a segment, or it shows a surface behind
    /// that of the frame, which is new then.
    pub fn known_pixels(&self) -> Image<bool> {
        Image::from_fn(self.frame.width(), self.frame.height(), |column, row| {
            let at = (column, row);
            let is_new = self.frame.depth()[at] > 0.0 && self.silhouette[at] > COVERED && self.covered[at] < COVERED;
            is_new || self.belief.segments[at] != 0
        })
    }

    /// The frame's pose in the coordinates of the map.
    pub fn map_from_camera(&self) -> &LocalPose {
        &self.map_from_camera
    }

    /// The frame.
    pub fn frame(&self) -> &RgbdFrame<'f> {
        self.frame
    }

    /// The view of the map, with the blend weights of every pixel.
    pub fn view(&self) -> &View {
        &self.view
    }

    /// Rendered silhouette (accumulated alpha) in [0, 1], `[height, width]`.
    pub fn silhouette(&self) -> &Image<f32> {
        &self.silhouette
    }

    /// Rendered z-depth in metres, `[height, width]`; 0 where the map shows nothing.
    pub fn depth(&self) -> &Image<f32> {
        &self.depth
    }

    /// Assembles a map `[height, width]` from tiles: `read` fills the ids of each, `[16, 16]` row-major.
    pub fn map_tiles(&self, read: impl Fn(&TileWeights, &StoreTile, &mut [u32; PIXELS]) + Sync) -> SegmentMap {
        let (width, height) = (self.frame.width(), self.frame.height());
        let tiles = self.view.weights().tiles();
        let columns = self.view.weights().tile_columns();
        let mut map = SegmentMap::filled(width, height, 0);
        let band = (TileWeights::SIDE * width).max(1);
        map.pixels_mut().par_chunks_mut(band).enumerate().for_each(|(band, rows)| {
            let mut pixels = [0; PIXELS];
            for (tile, found) in tiles.iter().zip(&self.tiles).skip(band * columns).take(columns) {
                read(tile, found, &mut pixels);
                let ((left, _), (tile_width, tile_height)) = (tile.origin(), tile.size());
                for row in 0..tile_height {
                    let from = row * TileWeights::SIDE;
                    let to = row * width + left;
                    rows[to..to + tile_width].copy_from_slice(&pixels[from..from + tile_width]);
                }
            }
        });
        map
    }
}
