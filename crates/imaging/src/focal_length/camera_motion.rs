//! The motion of the camera between two views, for a focal length that is tried.
//!
//! A point of the one view lies on a line of the other, wherever it is in space; how far it is from there says how wrong
//! the motion or the focal length is (Sampson's distance). A camera that only turns fits such lines with any translation
//! and, in part, with a wrong focal length, but then the points themselves fall on each other. What fits with less freedom
//! is taken (Torr, "Geometric motion segmentation and model selection", 1998).

use super::view_pairs::ViewPair;
use super::{Costs, FOCAL_LENGTHS};
use glam::{DMat3, DQuat, DVec2, DVec3};
use splatseg_geometry::Cholesky;

/// How exactly corners are followed, in long sides of the image: 0.4 pixels of 320.
const NOISE: f64 = 0.4 / 320.0;
const STEPS: usize = 8;
/// The motion is found if a step saves less than this share of the cost.
const FOUND: f64 = 1e-4;
const FIRST_DAMPING: f64 = 1e-3;
const MOST_DAMPING: f64 = 1e3;

/// The cost of a pair for each of the focal lengths, at the best motion. Costs of pairs whose camera only turns and of others
/// can be compared.
pub(super) fn costs(pair: &ViewPair, focal_lengths: &Costs) -> Costs {
    let views = focal_lengths.map(|focal| Views::new(pair, focal));
    let turned = views.each_ref().map(|views| fitted(Rotation(DQuat::IDENTITY), |rotation| views.turned(rotation)));
    let mut epipolar: [(Motion, f64); FOCAL_LENGTHS] = std::array::from_fn(|index| {
        let starts = [DVec3::X, DVec3::Y, DVec3::Z].map(|along| Motion { turn: turned[index].0.0, along });
        let [x, y, z] = starts.map(|start| views[index].motion_from(start));
        better(better(x, y), z)
    });
    // The motion of the next focal length is a start that may lead to a lower minimum: upwards, then downwards.
    for (from, to) in
        (1..FOCAL_LENGTHS).map(|to| (to - 1, to)).chain((1..FOCAL_LENGTHS).rev().map(|from| (from, from - 1)))
    {
        epipolar[to] = better(epipolar[to], views[to].motion_from(epipolar[from].0));
    }
    // A line leaves each corner a freedom: its depth.
    let corners = pair.first.len() as f64;
    let freedom = libm::log(4.0) * corners + libm::log(4.0 * corners);
    let (turned, epipolar) = (turned.map(|(_, cost)| cost), epipolar.map(|(_, cost)| cost + freedom));
    if least(&turned) < least(&epipolar) { turned } else { epipolar }
}

/// The least of the costs.
pub(super) fn least(costs: &Costs) -> f64 {
    costs.iter().copied().fold(f64::INFINITY, f64::min)
}

/// The motion that costs less.
fn better(one: (Motion, f64), other: (Motion, f64)) -> (Motion, f64) {
    if other.1 < one.1 { other } else { one }
}

/// The rays of the corners, with z = 1, in the first and the second view.
struct Views {
    rays: Vec<(DVec3, DVec3)>,
    /// Deviation of a ray.
    noise: f64,
}

impl Views {
    fn new(pair: &ViewPair, focal: f64) -> Self {
        let ray = |place: &DVec2| (*place / focal).extend(1.0);
        let rays = pair.first.iter().zip(&pair.second).map(|(first, second)| (ray(first), ray(second))).collect();
        Self { rays, noise: NOISE / focal }
    }

    /// The motion close to `start` that fits best, and its cost.
    fn motion_from(&self, start: Motion) -> (Motion, f64) {
        fitted(start, |motion| self.along_lines(motion))
    }

    /// How far the corners are from their lines.
    fn along_lines(&self, motion: &Motion) -> Fit<5> {
        let mut fit = Fit::default();
        let [side, up] = motion.across();
        let turn = DMat3::from_quat(motion.turn);
        for (first, second) in &self.rays {
            let turned = turn * *first;
            let normal = second.cross(motion.along);
            // The epipolar line of the first ray, and that of the second turned back.
            let (line, back) = (motion.along.cross(turned), turn.transpose() * normal);
            let weight = 1.0 / (line.truncate().length_squared() + back.truncate().length_squared()).sqrt().max(1e-12);
            let by_turn = turned.cross(normal);
            let by_translation = turned.cross(*second);
            let slope = [by_turn.x, by_turn.y, by_turn.z, by_translation.dot(side), by_translation.dot(up)];
            let scale = weight / self.noise;
            fit.add(&[(normal.dot(turned) * scale, slope.map(|slope| slope * scale))]);
        }
        fit
    }

    /// How far the corners are from where a rotation alone takes them.
    fn turned(&self, rotation: &Rotation) -> Fit<3> {
        let mut fit = Fit::default();
        let turn = DMat3::from_quat(rotation.0);
        for (first, second) in &self.rays {
            let turned = turn * *first;
            let depth = turned.z.max(1e-3);
            let seen = turned.truncate() / depth;
            let missing = (seen - second.truncate()) / self.noise;
            // A turn w moves the ray by w × ray.
            let scale = 1.0 / (depth * self.noise);
            let across = [-seen.x * turned.y, turned.z + seen.x * turned.x, -turned.y];
            let down = [-turned.z - seen.y * turned.y, seen.y * turned.x, turned.x];
            fit.add(&[(missing.x, across.map(|slope| slope * scale)), (missing.y, down.map(|slope| slope * scale))]);
        }
        fit
    }
}

/// Unknowns that are optimised in steps of `N` numbers.
trait Moves<const N: usize>: Copy {
    fn moved(&self, step: &[f64; N]) -> Self;
}

/// A motion whose translation has no length.
#[derive(Clone, Copy, Debug)]
struct Motion {
    /// From the axes of the first camera to those of the second.
    turn: DQuat,
    /// Direction of the translation, in the axes of the second camera.
    along: DVec3,
}

impl Motion {
    /// Two directions across the translation.
    fn across(&self) -> [DVec3; 2] {
        let (side, up) = self.along.any_orthonormal_pair();
        [side, up]
    }
}

impl Moves<5> for Motion {
    fn moved(&self, &[x, y, z, across, up]: &[f64; 5]) -> Self {
        let [first, second] = self.across();
        let along = (self.along + across * first + up * second).normalize();
        Self { turn: turned(self.turn, DVec3::new(x, y, z)), along }
    }
}

#[derive(Clone, Copy, Debug)]
struct Rotation(DQuat);

impl Moves<3> for Rotation {
    fn moved(&self, step: &[f64; 3]) -> Self {
        Self(turned(self.0, DVec3::from_slice(step)))
    }
}

/// A rotation followed by a small one, without sines, whose bits differ between machines.
fn turned(rotation: DQuat, step: DVec3) -> DQuat {
    let half = 0.5 * step;
    (DQuat::from_xyzw(half.x, half.y, half.z, 1.0).normalize() * rotation).normalize()
}

/// Sums of residuals, in their deviations, and of their derivatives.
struct Fit<const N: usize> {
    /// Sum of `ln(1 + r²)`, in which outliers count little.
    cost: f64,
    hessian: [[f64; N]; N],
    gradient: [f64; N],
}

impl<const N: usize> Default for Fit<N> {
    fn default() -> Self {
        Self { cost: 0.0, hessian: [[0.0; N]; N], gradient: [0.0; N] }
    }
}

impl<const N: usize> Fit<N> {
    /// Adds a corner with its residuals and their slopes.
    fn add(&mut self, residuals: &[(f64, [f64; N])]) {
        let squared: f64 = residuals.iter().map(|(residual, _)| residual * residual).sum();
        self.cost += libm::log1p(squared);
        let weight = 1.0 / (1.0 + squared);
        for (residual, slope) in residuals {
            for ((row, gradient), by) in self.hessian.iter_mut().zip(&mut self.gradient).zip(slope) {
                *gradient += weight * by * residual;
                row.iter_mut().zip(slope).for_each(|(sum, other)| *sum += weight * by * other);
            }
        }
    }

    /// The step to the least cost, damped as Levenberg and Marquardt do.
    fn step(&self, damping: f64) -> Option<[f64; N]> {
        let mut damped = self.hessian;
        for (index, row) in damped.iter_mut().enumerate() {
            row[index] += damping * row[index] + 1e-9;
        }
        Some(Cholesky::new(&damped, 0.0)?.solve(&self.gradient.map(|part| -part)))
    }
}

/// The motion close to `start` that costs least, and its cost.
fn fitted<M: Moves<N>, const N: usize>(start: M, fit_of: impl Fn(&M) -> Fit<N>) -> (M, f64) {
    let (mut motion, mut fit) = (start, fit_of(&start));
    let mut damping = FIRST_DAMPING;
    for _ in 0..STEPS {
        let better = loop {
            let moved = fit.step(damping).map(|step| motion.moved(&step));
            let better = moved.map(|moved| (moved, fit_of(&moved))).filter(|(_, moved)| moved.cost < fit.cost);
            if better.is_some() || damping > MOST_DAMPING {
                break better;
            }
            damping *= 10.0;
        };
        let Some(better) = better else { break };
        let saved = fit.cost - better.1.cost;
        (motion, fit) = better;
        damping = (0.1 * damping).max(1e-9);
        if saved < FOUND * fit.cost {
            break;
        }
    }
    (motion, fit.cost)
}
