//! The folder of a run for which none was chosen, and opening its page.

use crate::support::{finish, numbered_scene, splatseg, stoppable_splatseg};
use std::fs;
use std::path::Path;

const SMALL: [&str; 4] = ["--max-frames", "2", "--resize", "96x72"];

#[test]
fn results_go_to_a_new_folder_named_like_the_scene() {
    let folder = tempfile::tempdir().unwrap();
    let room = folder.path().join("my room");
    fs::create_dir(&room).unwrap();
    let scene = numbered_scene(&room, 2);
    let name = scene.file_name().unwrap().to_str().unwrap().to_owned();
    let run = |here: &Path, scene: &Path, more: &[&str]| {
        finish(splatseg().current_dir(here).arg("run").arg(scene).args(SMALL).args(more))
    };
    let first = run(folder.path(), &scene, &[]);
    assert_eq!(first.code, 0, "{}", first.err);
    let out = format!("{name}-splatseg");
    assert!(first.out.contains(&format!("look at {out}/index.html")), "{}", first.out);
    let list = folder.path().join(&out).join("objects.json");
    let before = fs::metadata(&list).unwrap().modified().unwrap();

    // Nothing is overwritten, not even a file.
    fs::write(folder.path().join(format!("{out}-2")), "a file").unwrap();
    assert_eq!(run(folder.path(), &scene, &[]).code, 0);
    assert!(folder.path().join(format!("{out}-3/index.html")).is_file());
    assert_eq!(fs::metadata(&list).unwrap().modified().unwrap(), before);
    let refused = run(folder.path(), &scene, &["--overwrite"]);
    assert_eq!(refused.code, 2, "{}", refused.err);
    assert!(refused.err.contains("--out"), "{}", refused.err);

    // From inside the scene, the results are beside it.
    assert_eq!(run(&scene, Path::new("."), &[]).code, 0);
    assert!(scene.parent().unwrap().join(&out).join("index.html").is_file());
    // The last one is complete.
    let resumed = run(folder.path(), &scene, &["--resume"]);
    assert_eq!((resumed.code, resumed.out.trim()), (0, &*format!("{out}-3: the run is complete already")));
}

#[cfg(target_os = "linux")]
#[test]
fn the_page_is_opened_in_the_browser_if_there_is_one() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let (bin, opened) = (folder.path().join("bin"), folder.path().join("opened"));
    fs::create_dir(&bin).unwrap();
    let browser = bin.join("xdg-open");
    // Renamed, so that it is there only when it is complete.
    let script = "#!/bin/sh\nPATH=/usr/bin:/bin; echo \"$1\" > \"$OPENED.new\"; mv \"$OPENED.new\" \"$OPENED\"\n";
    fs::write(&browser, script).unwrap();
    fs::set_permissions(&browser, fs::Permissions::from_mode(0o755)).unwrap();
    let run = |out: &str, screen: Option<&str>| {
        let mut command = splatseg();
        command.current_dir(folder.path()).args([
            "run",
            "synthetic:frames=2,width=64,height=48",
            "--open",
            "--out",
            out,
        ]);
        command.env("PATH", &bin).env("OPENED", &opened);
        command.env_remove("WAYLAND_DISPLAY").env_remove("WSL_DISTRO_NAME").env_remove("DISPLAY");
        command.envs(screen.map(|screen| ("DISPLAY", screen)));
        finish(&mut command)
    };
    let headless = run("a", None);
    assert_eq!(headless.code, 0, "{}", headless.err);
    let page = folder.path().canonicalize().unwrap().join("a/index.html");
    assert!(headless.err.contains("there is no browser here"), "{}", headless.err);
    assert!(headless.err.contains(&page.display().to_string()), "{}", headless.err);
    assert!(!opened.exists());

    let shown = run("b", Some(":0"));
    assert_eq!(shown.code, 0, "{}", shown.err);
    assert!(!shown.err.contains("browser"), "{}", shown.err);
    for _ in 0..1000 {
        if opened.exists() {
            break;
        }
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    let page = folder.path().canonicalize().unwrap().join("b/index.html");
    assert_eq!(fs::read_to_string(&opened).unwrap().trim(), page.display().to_string());
}

#[test]
fn without_a_home_everything_works() {
    let folder = tempfile::tempdir().unwrap();
    let mut command = stoppable_splatseg();
    command.current_dir(folder.path()).env_clear().envs(std::env::var_os("PATH").map(|path| ("PATH", path)));
    let output = command.args(["run", "synthetic:frames=2,width=64,height=48"]).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(folder.path().join("synthetic-splatseg/index.html").is_file());
}
