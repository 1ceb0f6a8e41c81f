//! Writes the corpora that fuzzing starts from, a valid file of each kind for each target: `cargo run --example make_corpus`.

use splatseg_fuzz::{Place, scenes};
use std::fs;
use std::path::Path;

fn main() -> std::io::Result<()> {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/corpus"));
    let templates: [(&str, fn(&Path)); 14] = [
        ("images", scenes::images),
        ("sevenscenes", scenes::sevenscenes),
        ("scannet", scenes::scannet),
        ("sens", scenes::sens),
        ("tum", scenes::tum),
        ("replica", scenes::replica),
        ("mvpd", scenes::mvpd),
        ("folder", scenes::folder),
        ("mcap", scenes::mcap),
        ("db3", scenes::db3),
        ("bag", scenes::bag),
        ("mkv", scenes::mkv),
        ("depth_files", scenes::depth_files),
        ("phones", scenes::phones),
    ];
    for (target, template) in templates {
        write(folder, target, &Place::new(template).seeds())?;
    }
    let jpegs = fs::read_dir(folder.join("../../crates/jpeg/tests/data"))?;
    let mut jpegs: Vec<_> = jpegs.map(|entry| Ok(entry?.path())).collect::<std::io::Result<_>>()?;
    jpegs.retain(|path| path.extension().is_some_and(|extension| extension == "jpg"));
    jpegs.sort();
    write(folder, "jpeg", &jpegs.iter().map(fs::read).collect::<std::io::Result<Vec<_>>>()?)?;
    let bytes = splatseg_ros::to_cdr(&splatseg_ros::CameraInfo { d: vec![0.1; 5], ..Default::default() });
    let transforms = vec![splatseg_ros::TransformStamped::default(); 2];
    let transforms = splatseg_ros::to_cdr(&splatseg_ros::TfMessage { transforms });
    write(folder, "cdr", &[bytes.expect("CDR"), transforms.expect("CDR")])?;
    let texts = ["synthetic:frames=2,width=24,height=16,seed=3,noise=kinect,moving=2,camera=static", "synthetic"];
    write(folder, "synthetic", &texts.map(|text| text.as_bytes().to_vec()))?;
    #[cfg(feature = "maps")]
    write_maps(folder)?;
    Ok(())
}

/// Maps, networks and settings.
#[cfg(feature = "maps")]
fn write_maps(folder: &Path) -> std::io::Result<()> {
    use splatseg_fuzz::{files, sample};
    use splatseg_memory::MemoryKind;

    let with_choice = |choice: u8, bytes: &[u8]| [&[choice], bytes].concat();
    let pickle = files::module_pickle();
    write(folder, "torch", &[with_choice(0, &files::torch_file(&pickle))])?;
    write(folder, "pickle", &[pickle])?;
    let header = r#"{"__metadata__":{"splatseg":"{\"architecture\":\"unknown\"}"},
        "a.weight":{"dtype":"F32","shape":[2,1],"data_offsets":[0,8]},
        "b":{"dtype":"BF16","shape":[3],"data_offsets":[8,14]}}"#;
    write(folder, "safetensors", &[files::safetensors_file(header, &[1; 14])])?;
    write(
        folder,
        "tokenizer",
        &[b"the cat's 3 mugs, isn't it? <end_of_text>".to_vec(), b"a b</w>\nl o\nlo w</w>\n".to_vec()],
    )?;
    let saved = |kind| sample::saved(&sample::sample(kind, 3));
    let (evidence, features) = (saved(MemoryKind::Evidence), saved(MemoryKind::Features));
    write(folder, "ply", &[with_choice(0, &evidence), with_choice(128, &evidence), with_choice(129, &features)])?;
    let call = |name: &str, arguments: &str| {
        let params = format!(r#"{{"name":"{name}","arguments":{arguments}}}"#);
        format!(r#"{{"jsonrpc":"2.0","id":1,"method":"tools/call","params":{params}}}"#).into_bytes()
    };
    let calls = [
        ("list_objects", r#"{"limit":5,"name":"a","min_size_m":0.1}"#),
        ("find_objects", r#"{"words":"the small red one","limit":3}"#),
        ("where_is", r#"{"object":1}"#),
        ("what_is_near", r#"{"point":[0.5,0,1],"radius_m":2}"#),
        ("what_changed", r#"{"since":"server_start"}"#),
        ("picture_of", r#"{"object":2,"close_up":true}"#),
        ("plan_view", r#"{"objects":[1,"largest"]}"#),
    ];
    let calls = calls.map(|(name, arguments)| call(name, arguments));
    let whole: &[u8] = b"\0POST /mcp?token=0123456789abcdef HTTP/1.1\r\nHost: localhost\r\nContent-Length: 2\r\n\r\n{}";
    let over_http: Vec<_> = calls.iter().map(|call| with_choice(1, call)).chain([whole.to_vec()]).collect();
    write(folder, "mcp_http", &over_http)?;
    write(folder, "mcp", &calls)?;
    let settings = "method = \"fastsam-splat\"\nseed = 3\n[memory]\nmax_votes = 8.0\n[dataset]\nresize = \"320x240\"\n";
    write(folder, "config", &[settings.into(), b"memory.max_votes=8".to_vec(), b"segmenter=\"graph\"".to_vec()])
}

fn write(folder: &Path, target: &str, seeds: &[Vec<u8>]) -> std::io::Result<()> {
    let folder = folder.join(target);
    fs::create_dir_all(&folder)?;
    seeds.iter().zip(0..).try_for_each(|(seed, index)| fs::write(folder.join(format!("{index:02}")), seed))
}
