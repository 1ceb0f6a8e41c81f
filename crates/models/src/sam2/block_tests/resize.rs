use super::*;
use crate::sam2::resize::{Size, resize_antialiased, resize_bilinear, resize_frame};

#[test]
fn frames_and_masks_are_resized_as_officially() {
    let Some(folder) = folder("frames_and_masks_are_resized_as_officially") else { return };
    let golden = Golden::open(&folder, "mini_preprocess");
    let expected = golden.bytes("frames_resized_u8");
    for (index, expected) in expected.chunks_exact(SIDE * SIDE * 3).enumerate() {
        let resized = resize_frame(&frame(&folder, index), SIDE);
        assert!(resized.pixels().as_flattened() == expected, "frame {index}");
    }
    let video = Size { width: 288, height: 200 };
    let model = Size { width: SIDE, height: SIDE };
    let low = Size { width: 64, height: 64 };
    let masks = golden.floats("mask_video_u8");
    let soft: Vec<f32> =
        masks.chunks_exact(288 * 200).flat_map(|mask| resize_antialiased(mask, video, model)).collect();
    assert_close(
        "mask_resized_soft",
        &soft[..SIDE * SIDE],
        &golden.floats("mask_resized_soft"),
        Within::Absolute(1e-5),
    );
    let binary: Vec<f32> = soft.iter().map(|value| f32::from(*value >= 0.5)).collect();
    assert_close("mask_resized_binary", &binary, &golden.floats("mask_resized_binary_u8"), Within::Absolute(0.0));
    let logits: Vec<f32> = binary
        .chunks_exact(SIDE * SIDE)
        .flat_map(|mask| {
            let logits: Vec<f32> = mask.iter().map(|value| value * 20.0 - 10.0).collect();
            resize_antialiased(&logits, model, low)
        })
        .collect();
    assert_close("mask_low_res_logits", &logits, &golden.floats("mask_low_res_logits"), Within::Absolute(1e-5));
    let high = resize_bilinear(&logits[..4096], low, model);
    assert_close("high", &high, &golden.floats("mask_high_from_low_logits"), Within::Absolute(1e-5));
    let in_video = resize_bilinear(&logits[..4096], low, video);
    assert_close("video", &in_video, &golden.floats("mask_video_from_low_logits"), Within::Absolute(1e-5));
}
