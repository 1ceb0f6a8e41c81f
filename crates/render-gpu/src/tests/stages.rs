//! The exponential, prefix sums and sorting.

use super::{device, noise};
use crate::device::threads;
use crate::kernels::exp::exp_negative_all;
use crate::sorting::{Keyed, prefix_sums, sorted};
use splatseg_kernels::exp::exp_negative;

#[test]
fn the_exponential_is_that_of_the_cpu() {
    let Some(device) = device() else { return };
    let mut values: Vec<f32> = (0..60_000u16).map(|step| f32::from(step) * 5e-4).collect();
    values.extend([-1.0, 0.0, 0.5, 20.794_415, 1e30, f32::INFINITY]);
    let input = device.upload(&values, "test").unwrap();
    let output = device.empty(values.len(), "test").unwrap();
    let (cubes, cube) = threads(values.len());
    exp_negative_all::launch(&device.client, cubes, cube, input.arg(), output.arg());
    let [found] = device.download([&output]).unwrap();
    for (value, found) in values.iter().zip(found) {
        let (found, expected) = (f32::from_bits(found), exp_negative(*value));
        assert!((found - expected).abs() <= 4e-7 * expected, "e^-{value}: {found} instead of {expected}");
    }
}

#[test]
fn prefix_sums_are_those_of_a_loop() {
    let Some(device) = device() else { return };
    for count in [1, 255, 1024, 1025, 100_003] {
        let values: Vec<u32> = noise(1).take(count).map(|value| value % 7).collect();
        let sent = device.upload(&values, "test").unwrap();
        let [found] = device.download([&prefix_sums(&device, &sent, count).unwrap()]).unwrap();
        let expected: Vec<u32> =
            values.iter().scan(0, |sum, value| Some(std::mem::replace(sum, *sum + value))).collect();
        assert!(found == expected, "{count}");
    }
}

#[test]
fn sorting_keeps_the_order_of_equal_keys() {
    let Some(device) = device() else { return };
    for (count, bits) in [(1, 32), (700, 9), (5000, 32), (70_001, 9)] {
        let keys: Vec<u32> =
            noise(count).take(count as usize).map(|key| if bits == 32 { key << 7 } else { key % 300 }).collect();
        let values: Vec<u32> = (0..count).collect();
        let (sent_keys, sent_values) = (device.upload(&keys, "test").unwrap(), device.upload(&values, "test").unwrap());
        let found = sorted(&device, Keyed { keys: sent_keys, values: sent_values }, count as usize, bits).unwrap();
        let [found_keys, found_values] = device.download([&found.keys, &found.values]).unwrap();
        let mut expected = values;
        expected.sort_by_key(|value| keys[*value as usize]);
        assert!(found_values == expected, "{count} keys of {bits} bits");
        assert!(found_keys.is_sorted());
    }
}
