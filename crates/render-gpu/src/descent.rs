//! Gradient descent on the features of the Gaussians in view, as a sequence of kernels.

use crate::GpuError;
use crate::device::{Buffer, GpuDevice, cube_dim, cubes, threads};
use crate::kernels::active::{ActiveRuleLaunch, choose_active, find_differing, mark_touched, spread_in_rows};
use crate::kernels::blend::PIXELS;
use crate::kernels::descend::{DescentStateLaunch, StepRuleLaunch, differentiate, row_length, start_descent, step};
use crate::kernels::entries::{EntriesLaunch, count_entries, write_entries};
use crate::kernels::scan::take_total;
use crate::sorting::{Keyed, prefix_sums, sorted};
use crate::store::Lesson;
use crate::view::{GpuView, Tiles, bin, look, tile_count};
use splatseg_memory::{FrameTrust, MemorySettings};

/// A Gaussian that a frame added prevails where it has at least this alpha in front of what was there.
const NEW_GAUSSIAN_PREVAILS: f32 = 0.5;

/// One optimisation of a frame's features.
#[derive(Debug)]
pub(crate) struct Descent<'a> {
    pub lesson: &'a Lesson<'a>,
    /// What the memory rendered before it grew.
    pub view: &'a GpuView,
    /// Rendered features, `[height, width, dim]`.
    pub rendered: &'a Buffer,
    pub settings: &'a MemorySettings,
    /// `[N, dim]`.
    pub codes: &'a Buffer,
    pub dim: usize,
}

/// Blend weights at active pixels, see `kernels/entries.rs`.
struct Entries {
    /// The first of each place, and how many it has.
    starts: Buffer,
    counts: Buffer,
    /// Of each entry.
    weights: Buffer,
    places: Buffer,
    splats: Buffer,
    /// Their numbers, with their pairs as keys.
    by_pair: Keyed,
    /// The sum of all weights of each pair.
    pair_sums: Buffer,
    count: usize,
    /// Number of active pixels.
    pixels: usize,
}

impl Entries {
    fn args(&self) -> EntriesLaunch {
        let Keyed { keys, values } = &self.by_pair;
        EntriesLaunch::new(self.weights.arg(), self.places.arg(), self.splats.arg(), keys.arg(), values.arg())
    }
}

/// What steps work on, see `kernels/descend.rs`.
struct State {
    begins: Buffer,
    ends: Buffer,
    weight_sums: Buffer,
    ahead: Buffer,
    gradients: Buffer,
}

impl State {
    fn args(&self) -> DescentStateLaunch {
        DescentStateLaunch::new(
            self.begins.arg(),
            self.ends.arg(),
            self.weight_sums.arg(),
            self.ahead.arg(),
            self.gradients.arg(),
        )
    }
}

impl Descent<'_> {
    /// Takes the settings' number of steps; returns the number of pixels in the loss.
    pub fn run(&self) -> Result<usize, GpuError> {
        if self.settings.num_steps == 0 {
            return Ok(0);
        }
        let (active, active_count) = self.active_pixels()?;
        let grown;
        let tiles = match self.settings.learn_new {
            true => {
                grown = self.grown_tiles()?;
                &grown
            }
            false => &self.view.tiles,
        };
        let entries = self.entries(tiles, &active, &active_count)?;
        if entries.count == 0 {
            return Ok(entries.pixels);
        }
        let state = self.start(tiles, &entries)?;
        for number in 0..self.settings.num_steps {
            self.differentiate(&entries, &state);
            self.step(tiles, &entries, &state, number as f32 / (number as f32 + 3.0));
        }
        Ok(entries.pixels)
    }

    fn device(&self) -> &GpuDevice {
        self.lesson.device
    }

    fn active_rule(&self) -> ActiveRuleLaunch {
        let settings = self.settings;
        let intrinsics = &self.view.camera.intrinsics;
        ActiveRuleLaunch::new(
            if settings.learn_new { -1.0 } else { settings.growth_silhouette },
            settings.active_tolerance,
            settings.active_min_cosine,
            settings.active_margin as u32,
            intrinsics.width as u32,
            intrinsics.height as u32,
        )
    }

    fn step_rule(&self, momentum: f32) -> StepRuleLaunch {
        let settings = self.settings;
        StepRuleLaunch::new(
            settings.magnitude_weight,
            settings.direction_weight,
            settings.learning_rate,
            settings.direction_learning_rate,
            momentum,
        )
    }

    /// The pixels to be learnt, and their number.
    fn active_pixels(&self) -> Result<(Buffer, Buffer), GpuError> {
        let (device, pixels) = (self.device(), self.view.pixels());
        let client = &device.client;
        let [differs, near, active] = [(); 3].map(|()| device.empty(pixels, "active pixels"));
        let (differs, near, active) = (differs?, near?, active?);
        let touched = self.touched()?;
        let count = device.zeros(1, "active pixels")?;
        let (cubes, cube) = threads(pixels);
        find_differing::launch(
            client,
            cubes.clone(),
            cube,
            self.rendered.arg(),
            self.view.images.arg(),
            self.lesson.target.arg(),
            self.codes.arg(),
            differs.arg(),
            self.active_rule(),
            self.dim,
        );
        spread_in_rows::launch(client, cubes.clone(), cube, differs.arg(), near.arg(), self.active_rule());
        choose_active::launch(
            client,
            cubes,
            cube,
            near.arg(),
            touched.arg(),
            self.view.images.arg(),
            active.arg(),
            count.arg(),
            self.active_rule(),
        );
        Ok((active, count))
    }

    /// The pixels on which Gaussians prevail that have grown since the view was made, unless these are learnt, too.
    fn touched(&self) -> Result<Buffer, GpuError> {
        let device = self.device();
        let touched = device.zeros(self.view.pixels(), "pixels of new Gaussians")?;
        let (first, count) = (self.view.sights.count, self.lesson.gaussians.len());
        if self.settings.learn_new || count == first {
            return Ok(touched);
        }
        let reach = (NEW_GAUSSIAN_PREVAILS.ln() / self.view.camera.limits.min_alpha.ln()).sqrt();
        let (cubes, cube) = threads(count - first);
        mark_touched::launch(
            &device.client,
            cubes,
            cube,
            self.lesson.gaussians.balls().arg(),
            self.view.images.arg(),
            touched.arg(),
            self.view.args(),
            reach,
            first as u32,
            count as u32,
        );
        Ok(touched)
    }

    /// The tiles of the map with its new Gaussians; nothing is hidden.
    fn grown_tiles(&self) -> Result<Tiles, GpuError> {
        let (device, map, view) = (self.device(), self.lesson.gaussians, self.view);
        let all = self.settings.clone().with(|settings| settings.removal_frames = 0);
        bin(device, map, &look(device, map, &view.depth, &view.camera, FrameTrust::Alone, &all)?, &view.camera)
    }

    fn entries(&self, tiles: &Tiles, active: &Buffer, active_count: &Buffer) -> Result<Entries, GpuError> {
        let device = self.device();
        let tile_count = tile_count(&self.view.camera);
        let places = PIXELS * tile_count;
        let counts = device.empty(places, "entries of pixels")?;
        let pair_sums = device.zeros(tiles.pair_count, "weights of pairs")?;
        count_entries::launch(
            &device.client,
            cubes(tile_count),
            cube_dim(),
            tiles.pairs(),
            active.arg(),
            counts.arg(),
            pair_sums.arg(),
            self.view.args(),
            self.settings.learning_min_weight,
        );
        let starts = prefix_sums(device, &counts, places)?;
        let total = device.empty(1, "entries of pixels")?;
        take_total::launch(
            &device.client,
            cubes(1),
            cube_dim(),
            counts.arg(),
            starts.arg(),
            total.arg(),
            places as u32,
        );
        let [total, pixels] = device.download([&total, active_count])?;
        let (count, pixels) = (total[0] as usize, pixels[0] as usize);
        let room = || device.empty(count, "entries of pixels");
        let (weights, places, splats) = (room()?, room()?, room()?);
        let by_pair = Keyed { keys: room()?, values: room()? };
        let mut entries = Entries { starts, counts, weights, places, splats, by_pair, pair_sums, count, pixels };
        write_entries::launch(
            &device.client,
            cubes(tile_count),
            cube_dim(),
            tiles.pairs(),
            active.arg(),
            entries.starts.arg(),
            entries.args(),
            self.view.args(),
            self.settings.learning_min_weight,
        );
        let bits = tiles.pair_count.next_power_of_two().ilog2().max(1);
        entries.by_pair = sorted(device, entries.by_pair, count, bits)?;
        Ok(entries)
    }

    fn start(&self, tiles: &Tiles, entries: &Entries) -> Result<State, GpuError> {
        let (device, row) = (self.device(), row_length(self.dim));
        let visible = tiles.visible_count;
        let state = State {
            begins: device.empty(visible, "entries of Gaussians")?,
            ends: device.empty(visible, "entries of Gaussians")?,
            weight_sums: device.empty(visible, "weights of Gaussians")?,
            ahead: device.empty(visible * row, "features in view")?,
            gradients: device.empty(PIXELS * tile_count(&self.view.camera) * row, "gradients of pixels")?,
        };
        let (cubes, cube) = threads(visible);
        start_descent::launch(
            &device.client,
            cubes,
            cube,
            tiles.visible(),
            entries.by_pair.keys.arg(),
            entries.pair_sums.arg(),
            self.lesson.gaussians.remembered(0).arg(),
            state.args(),
            self.lesson.report.arg(),
            entries.count as u32,
            visible as u32,
            self.dim,
        );
        Ok(state)
    }

    fn differentiate(&self, entries: &Entries, state: &State) {
        let intrinsics = &self.view.camera.intrinsics;
        let (cubes, cube) = threads(PIXELS * tile_count(&self.view.camera));
        differentiate::launch(
            &self.device().client,
            cubes,
            cube,
            entries.starts.arg(),
            entries.counts.arg(),
            entries.args(),
            state.args(),
            self.lesson.target.arg(),
            self.codes.arg(),
            self.step_rule(0.0),
            intrinsics.width as u32,
            intrinsics.height as u32,
            self.dim,
        );
    }

    fn step(&self, tiles: &Tiles, entries: &Entries, state: &State, momentum: f32) {
        let (cubes, cube) = threads(tiles.visible_count);
        step::launch(
            &self.device().client,
            cubes,
            cube,
            tiles.visible(),
            entries.args(),
            state.args(),
            self.lesson.gaussians.remembered(0).arg(),
            self.step_rule(momentum),
            tiles.visible_count as u32,
            self.dim,
        );
    }
}
