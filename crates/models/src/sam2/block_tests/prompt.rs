use super::*;

#[test]
fn prompt_encoder() {
    let Some(folder) = folder("prompt_encoder") else { return };
    let golden = Golden::open(&folder, "mini_prompt_encoder");
    let network = mini(&folder);
    let encoder = &network.heads.prompt_encoder;
    for case in CASES {
        let (mut points, masked) = prompt(&golden, case);
        if points.is_empty() {
            points.push(InputPoint::NONE);
        }
        points.push(InputPoint::NONE);
        let sparse = encoder.embed_points(&[points]);
        assert_close(&format!("{case}.sparse"), &values(sparse), &golden.floats(&format!("{case}.sparse")), CLOSE);
        let dense = if masked {
            encoder.embed_masks(tensor::<4>(&golden, "mask_input").squeeze_dim(1)).reshape([1, 16, 16, 64])
        } else {
            encoder.no_mask().reshape([1, 1, 1, 64])
        };
        assert_planes(&golden, &format!("{case}.dense"), dense, CLOSE);
    }
    let dense_pe = encoder.dense_position_encoding(16).reshape([1, 16, 16, 64]);
    assert_planes(&golden, "dense_pe", dense_pe, CLOSE);
}
