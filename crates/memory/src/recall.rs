//! The memory as one frame's camera sees it.

use crate::backend::FrameTrust;
use crate::depthless::DepthlessSight;
use crate::removal::{Present, Sight, sights};
use crate::segment_store::{SegmentStore, StoreTile};
use crate::splat_memory::DeviceFailure;
use crate::{GrowthRule, MemoryKind, MemorySettings, SegmentBelief};
use rayon::prelude::*;
use splatseg_geometry::{CowImage, Image, LocalPose, Pose, RgbdFrame, SegmentMap};
use splatseg_render::{Balls, Camera, TileWeights, View};
use std::any::Any;

/// Pixels of a tile.
const PIXELS: usize = TileWeights::PIXELS;

/// What the memory expects a frame to show, made by [`SplatMemory::recall`](crate::SplatMemory::recall) before the frame
/// is taken in.
#[derive(Debug)]
pub struct Recall<'f> {
    pub(crate) frame: &'f RgbdFrame<'f>,
    pub(crate) view: View,
    /// The frame's pose in the coordinates of the map.
    pub(crate) map_from_camera: LocalPose,
    /// Where the view was taken from: another pose if the poses have jumped, and the map has not yet followed.
    pub(crate) viewed_from: LocalPose,
    /// The transform to the world of the frame's pose, if that of earlier poses was another.
    pub(crate) jump: Option<Pose>,
    /// Whether the frame sees through more than half of the Gaussians that it can judge.
    pub(crate) contradicts_map: bool,
    /// Whether the ids of the previous frame are expected where the map cannot say.
    pub(crate) links_previous: bool,
    /// What the frame says of every Gaussian; empty for the paper's memory, which does not ask.
    pub(crate) sights: Vec<Sight>,
    pub(crate) belief: SegmentBelief,
    /// Rendered silhouette (accumulated alpha) in [0, 1], `[height, width]`.
    pub(crate) silhouette: Image<f32>,
    /// Rendered z-depth in metres, divided by the silhouette, `[height, width]`; 0 where nothing is seen.
    pub(crate) depth: Image<f32>,
    /// Accumulated alpha up to the frame's own surface in [0, 1], `[height, width]`: near 0 where the map lacks it.
    pub(crate) covered: Image<f32>,
    pub(crate) tiles: Vec<StoreTile>,
    /// Where remembered segments without depth should be seen.
    pub(crate) depthless: Vec<DepthlessSight>,
    /// What a device keeps of its own view.
    device: Option<Box<dyn Any + Send + Sync>>,
    /// Why the device could not make the view.
    pub(crate) failure: Option<DeviceFailure>,
}

/// The images of a view that was made on a device, each `[height, width]`.
#[derive(Clone, Debug)]
pub struct DeviceImages {
    /// The expected segments.
    pub belief: SegmentBelief,
    /// Accumulated alpha.
    pub silhouette: Image<f32>,
    /// Rendered z-depth, metres, divided by the silhouette; 0 where nothing is seen.
    pub depth: Image<f32>,
    /// Whether the frame sees through more than half of the Gaussians that it can judge.
    pub contradicts_map: bool,
}

/// What a tile of the frame and of the map look like, whatever is remembered of segments. Buffers are `[16, 16]`.
#[derive(Clone, Debug)]
pub struct TileSurface {
    /// Accumulated alpha.
    pub silhouette: [f32; PIXELS],
    /// Rendered z-depth, metres, divided by the silhouette.
    pub depth: [f32; PIXELS],
    /// The frame's z-depth, metres, 0 where missing.
    pub observed: [f32; PIXELS],
    /// Accumulated alpha of what does not lie behind the frame's own surface.
    pub covered: [f32; PIXELS],
}

impl<'f> Recall<'f> {
    /// Looks at `map` with the camera of `frame` and reads what `store` expects there.
    ///
    /// Gaussians that the frame sees through are left out. What lies up to `depth_disparity` behind the frame's surface
    /// counts as that surface.
    pub(crate) fn new(
        map: &Balls,
        store: &dyn SegmentStore,
        frame: &'f RgbdFrame,
        camera: &Camera,
        trust: FrameTrust,
        settings: &MemorySettings,
    ) -> Self {
        let tolerance = settings.depth_disparity;
        let is_paper = settings.growth_rule() == GrowthRule::Paper;
        let needs_sights = !is_paper || settings.kind == MemoryKind::Evidence;
        let (sights, contradicts_map) = match needs_sights {
            true => sights(map, frame, camera, trust, settings),
            false => (Vec::new(), false),
        };
        let forgets = !is_paper && settings.removal_frames > 0;
        let present = Present::new(map, if forgets { &sights } else { &[] });
        let (view, tiles) = View::read(&present, camera, |tile| {
            let surface = TileSurface::read(tile, frame.depth(), tolerance);
            (store.read_tile(tile, &surface), surface)
        });
        let (width, height) = (frame.width(), frame.height());
        let mut recall = Self {
            frame,
            view,
            map_from_camera: LocalPose::IDENTITY,
            viewed_from: LocalPose::IDENTITY,
            jump: None,
            contradicts_map,
            links_previous: false,
            sights,
            belief: SegmentBelief::empty(width, height),
            silhouette: Image::filled(width, height, 0.0),
            depth: Image::filled(width, height, 0.0),
            covered: Image::filled(width, height, 0.0),
            tiles: Vec::with_capacity(tiles.len()),
            depthless: Vec::new(),
            device: None,
            failure: None,
        };
        for (index, (found, surface)) in tiles.into_iter().enumerate() {
            recall.put(index, &found, &surface);
            recall.tiles.push(StoreTile { segments: Vec::new(), confidence: Vec::new(), ..found });
        }
        recall
    }

    /// What a device has found; `view` is what it keeps for the rest of the frame.
    pub fn of_device(
        frame: &'f RgbdFrame,
        camera: &Camera,
        images: DeviceImages,
        view: Box<dyn Any + Send + Sync>,
    ) -> Self {
        let DeviceImages { belief, silhouette, depth, contradicts_map } = images;
        // What is missing is found on the device.
        let covered = Image::filled(frame.width(), frame.height(), 0.0);
        let (sights, tiles, depthless) = (Vec::new(), Vec::new(), Vec::new());
        let host = View::new(&Balls::default(), camera);
        let (device, failure) = (Some(view), None);
        let (jump, view) = (None, host);
        let [map_from_camera, viewed_from] = [LocalPose::IDENTITY; 2];
        Self {
            frame,
            view,
            map_from_camera,
            viewed_from,
            jump,
            contradicts_map,
            links_previous: false,
            sights,
            belief,
            silhouette,
            depth,
            covered,
            tiles,
            depthless,
            device,
            failure,
        }
    }

    /// Of a view that could not be made: nothing is expected, and whoever goes on with it is told why.
    pub(crate) fn failed(frame: &'f RgbdFrame, camera: &Camera, failure: DeviceFailure) -> Self {
        let (width, height) = (frame.width(), frame.height());
        let dark = Image::filled(width, height, 0.0);
        let belief = SegmentBelief::empty(width, height);
        let images = DeviceImages { belief, silhouette: dark.clone(), depth: dark, contradicts_map: false };
        Self { failure: Some(failure), ..Self::of_device(frame, camera, images, Box::new(())) }
    }

    /// Notes the frame's pose in the coordinates that the map is moved to.
    pub(crate) fn moved_to(&mut self, map_from_camera: LocalPose) {
        let limits = self.view.camera().limits;
        self.view.set_camera(Camera { limits, ..Camera::new(*self.frame.intrinsics(), &map_from_camera) });
        (self.map_from_camera, self.viewed_from) = (map_from_camera, map_from_camera);
    }

    /// What the device that made the view keeps of it, if that is a `T`.
    pub fn device_view_mut<T: 'static>(&mut self) -> Option<&mut T> {
        self.device.as_mut()?.downcast_mut()
    }

    /// What the device that made the view keeps of it, if that is a `T`.
    pub fn device_view<T: 'static>(&self) -> Option<&T> {
        self.device.as_ref()?.downcast_ref()
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

    /// The segments that the memory expects to be seen, and how sure it is of them.
    pub fn expected(&self) -> &SegmentBelief {
        &self.belief
    }

    /// The frame's pose in the coordinates of the map.
    pub fn map_from_camera(&self) -> &LocalPose {
        &self.map_from_camera
    }

    /// The frame.
    pub fn frame(&self) -> &RgbdFrame<'f> {
        self.frame
    }

    /// The view of the map, with the blend weights of every pixel. It is empty if the map is kept on a device, where the
    /// weights stay.
    pub fn view(&self) -> &View {
        &self.view
    }

    /// Rendered silhouette (accumulated alpha) in [0, 1], `[height, width]`.
    pub fn silhouette(&self) -> &Image<f32> {
        &self.silhouette
    }

    /// Rendered z-depth in metres, `[height, width]`; 0 where nothing is seen.
    pub fn depth(&self) -> &Image<f32> {
        &self.depth
    }

    /// `[height, width]` of what `read` makes of each tile, `[16, 16]` row-major; empty tiles if the map is on a device.
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

impl TileSurface {
    fn read(tile: &TileWeights, observed: &CowImage<'_, f32>, tolerance: f32) -> Self {
        let mut surface = Self {
            silhouette: [0.0; PIXELS],
            depth: [0.0; PIXELS],
            covered: [0.0; PIXELS],
            observed: cut(tile, observed),
        };
        let limit = surface.observed.map(|depth| depth + tolerance);
        for (column, depth) in tile.depths().iter().enumerate() {
            for (pixel, weight) in tile.column(column) {
                let pixel = usize::from(pixel);
                surface.silhouette[pixel] += weight;
                surface.depth[pixel] += weight * depth;
                surface.covered[pixel] += if *depth <= limit[pixel] { weight } else { 0.0 };
            }
        }
        for (depth, silhouette) in surface.depth.iter_mut().zip(&surface.silhouette) {
            *depth = if *silhouette > 0.0 { *depth / silhouette } else { 0.0 };
        }
        surface
    }
}

/// A tile's part of an image, `[16, 16]`; the default where the image ends.
pub(crate) fn cut<T: Copy + Default>(tile: &TileWeights, image: &CowImage<'_, T>) -> [T; PIXELS] {
    let ((left, top), (width, height)) = (tile.origin(), tile.size());
    let mut part = [T::default(); PIXELS];
    for row in 0..height {
        let from = row * TileWeights::SIDE;
        part[from..from + width].copy_from_slice(&image.row(top + row)[left..left + width]);
    }
    part
}
