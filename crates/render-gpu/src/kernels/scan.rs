//! Exclusive prefix sums, block by block: sums of blocks, their prefix sums, then the blocks' own.

use cubecl::prelude::*;

/// Threads of a cube.
pub(crate) const THREADS: usize = 256;
/// Values that a thread adds up by itself.
pub(crate) const PER_THREAD: usize = 4;
/// Values of a block.
pub(crate) const BLOCK: usize = THREADS * PER_THREAD;

/// Turns `shared`, one value per thread, into the sums of all values up to and with each.
#[cube]
pub(crate) fn inclusive_scan(shared: &mut Shared<[u32]>) {
    let unit = UNIT_POS as usize;
    #[unroll]
    for step in 0..8u32 {
        let reach = comptime!(1usize << step);
        sync_cube();
        let mut before = 0u32;
        if unit >= reach {
            before = shared[unit - reach];
        }
        sync_cube();
        shared[unit] += before;
    }
    sync_cube();
}

/// The sum of the `length` values that this thread has; `shared` becomes the sums of its cube's up to and with each thread's.
#[cube]
fn sum_own(values: &[u32], length: usize, count: u32, shared: &mut Shared<[u32]>) -> u32 {
    let first = ABSOLUTE_POS * length;
    let mut sum = 0u32;
    for step in 0..length {
        if first + step < count as usize {
            sum += values[first + step];
        }
    }
    shared[UNIT_POS as usize] = sum;
    inclusive_scan(shared);
    sum
}

/// The sum of each block of `values`.
#[cube(launch)]
pub(crate) fn sum_blocks(values: &[u32], sums: &mut [u32], count: u32) {
    let mut shared = Shared::<[u32]>::new_slice(THREADS);
    sum_own(values, PER_THREAD.runtime(), count, &mut shared);
    if UNIT_POS == 255 && CUBE_POS < sums.len() {
        sums[CUBE_POS] = shared[255];
    }
}

/// Writes the exclusive prefix sums of the `length` values of each thread, those of its cube from `start` on.
#[cube]
fn scan_own(values: &[u32], start: u32, scanned: &mut [u32], length: usize, count: u32) {
    let mut shared = Shared::<[u32]>::new_slice(THREADS);
    let sum = sum_own(values, length, count, &mut shared);
    let mut running = start + shared[UNIT_POS as usize] - sum;
    let first = ABSOLUTE_POS * length;
    for step in 0..length {
        if first + step < count as usize {
            scanned[first + step] = running;
            running += values[first + step];
        }
    }
}

/// Exclusive prefix sums of `sums`, by a single cube.
#[cube(launch)]
pub(crate) fn scan_sums(sums: &[u32], starts: &mut [u32], count: u32) {
    scan_own(sums, 0u32, starts, (count as usize).div_ceil(THREADS), count);
}

/// Exclusive prefix sums of `values`, each block's from its entry in `starts` on.
#[cube(launch)]
pub(crate) fn scan_blocks(values: &[u32], starts: &[u32], scanned: &mut [u32], count: u32) {
    scan_own(values, starts[CUBE_POS], scanned, PER_THREAD.runtime(), count);
}

/// The sum of the first `count` values, from their prefix sums.
#[cube(launch)]
pub(crate) fn take_total(values: &[u32], scanned: &[u32], total: &mut [u32], count: u32) {
    if ABSOLUTE_POS == 0 {
        let last = count as usize - 1;
        total[0] = scanned[last] + values[last];
    }
}
