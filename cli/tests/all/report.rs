//! The report as a file: what is in it, and that nothing comes from outside. tests/web looks at it in a browser.

use std::path::Path;

use crate::common::{golden, root, scratch, tiny_card};
use gravisight::Clips;
use gravisight::Device;
use gravisight::parts::Bins;
use gravisight::score;
use gravisight::{Error, Localiser};
use gravisight_cli::report::{self, Log, Report};

const BINS: Bins = Bins { count: 3, z_min: 5.0, z_max: 9.0 };

/// The samples, their first clip's id replaced.
fn clips(id: &str) -> Clips {
    let mut clips = Clips::read(&root().join("tests/samples")).unwrap();
    clips.clips[0].id = id.into();
    clips
}

fn report(name: &str, clips: &Clips, log: Option<&Path>) -> Result<String, Error> {
    let log = log.map(Log::read).transpose()?;
    let log = log.as_ref();
    let localiser = Localiser::new(tiny_card(), golden("tiny.safetensors"), &Device::flex()).unwrap();
    let samples = pollster::block_on(score(&localiser, clips, None, None, &|| 0.0, &mut |_, _| {})).unwrap();
    let path = scratch(name).join("report.html");
    report::write(&path, &Report { localiser: &localiser, clips, samples: &samples, bins: BINS, log })?;
    assert_eq!(std::fs::read_dir(path.parent().unwrap()).unwrap().count(), 1, "no temporary file is left");
    Ok(std::fs::read_to_string(path).unwrap())
}

#[test]
fn a_report_is_one_file_that_asks_for_no_other() {
    let html = report("report", &clips("train/env1/cam1/0000"), None).unwrap();
    for title in [
        "How far off",
        "Environments and cameras",
        "Calibration of the confidence",
        "A trajectory",
        "heatmaps and depth maps",
        "Where it failed",
        "determine the depth",
    ] {
        assert!(html.contains(title), "{title}");
    }
    for address in ["http://", "https://", "<script", "@import", "url("] {
        // The name of SVG's vocabulary is no address that anyone asks.
        let html = html.replace("xmlns=\"http://www.w3.org/2000/svg\"", "");
        assert!(!html.contains(address), "{address}");
    }
    assert!(html.matches("href=\"data:").count() > 6);
    assert!(!html.contains(root().to_str().unwrap()), "no path of this machine");
}

#[test]
fn the_papers_numbers_stand_beside_its_own_scenes_only() {
    let html = report("paper", &clips("train/env1/cam1/0000"), None).unwrap();
    assert!(html.contains("22 ± 19 (SD-S)\n19 ± 10 (SD-M)\n11 ± 6 (SD-L)"));
    let mut others = clips("train/env1/cam1/0000");
    others.clips[1].scene.as_mut().unwrap().boxes[0].half_size[2] = 0.5;
    let html = report("not-the-papers", &others, None).unwrap();
    assert!(html.contains("env1 cam1") && !html.contains("SD-M"));
}

#[test]
fn a_clips_name_is_text_whatever_is_in_it() {
    let name = "<img src=x onerror=\"alert('&')\">";
    let html = report("hostile", &clips(name), None).unwrap();
    assert!(!html.contains("<img") && html.contains("&lt;img src=x onerror=&quot;alert(&#39;&amp;&#39;)&quot;&gt;"));
}

#[test]
fn the_runs_curves_are_drawn_and_a_damaged_log_is_refused_by_its_line() {
    let log = scratch("log").join("log.jsonl");
    let line = |step: usize, more: &str| {
        format!("{{\"step\":{step},\"loss\":{},\"learning_rate\":1{more}}}\n", 9.0 / step as f64)
    };
    let validation = r#","validation":{"dtg":{"mean":0.5,"std":0.1,"median":0.4,"n":3}}"#;
    std::fs::write(
        &log,
        (1..500).map(|step| line(step, if step % 100 == 0 { validation } else { "" })).collect::<String>(),
    )
    .unwrap();
    let clips = clips("train/env1/cam1/0000");
    let html = report("curves", &clips, Some(&log)).unwrap();
    assert!(html.contains("How it was trained") && html.contains("Validation: dtg"));
    std::fs::write(&log, line(1, "") + "{\"loss\": 2}\n").unwrap();
    let message = report("damaged", &clips, Some(&log)).unwrap_err().to_string();
    assert!(message.contains("log.jsonl:2") && message.contains("`step`"), "{message}");
}
