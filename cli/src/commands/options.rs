//! Which test of the command checks which option: an option that the table lacks fails it.

use std::collections::BTreeSet;
use std::path::Path;

use clap::CommandFactory as _;

use super::Arguments;

/// A subcommand's options, by the test (`file::name`, in `tests/all/`) that passes them and checks what they do.
type Checked = (&'static str, &'static [(&'static str, &'static [&'static str])]);

#[rustfmt::skip]
const CHECKED: [Checked; 14] = [
    ("localise", &[
        ("cli::the_built_in_model_finds_the_samples_within_half_a_metre_and_two_pixels", &["camera"]),
        ("cli::the_model_of_rendered_scenes_is_taken_by_its_name_alone", &["model"]),
        ("options::localise_measures_the_ball_in_the_region_and_the_scene_that_are_given", &["ball-radius", "ball", "scene", "region", "candidates"]),
        ("cli::a_device_that_was_not_built_in_says_how_to_build_it", &["device"]),
        ("cli::words_and_an_overlay_for_people", &["overlay"]),
        ("cli::several_pictures_give_one_object_a_line_with_their_files", &["json"]),
    ]),
    ("track", &[
        ("track::a_clip_becomes_flights_in_metres", &["camera", "scene", "out", "report"]),
        ("options::track_and_label_take_camera_ball_numbers_model_and_device", &["camera-sigma", "ball", "fps", "hits", "config", "model", "device"]),
        ("track::a_video_without_a_calibration_is_measured_by_a_phone_that_is_assumed", &["assume-phone"]),
        ("track::of_several_labels_for_a_frame_the_last_counts", &["seed-label"]),
        ("track::a_film_is_read_and_one_with_the_ball_marked_written", &["overlay"]),
        ("track::without_a_camera_there_is_a_track_alone", &["json"]),
        ("calibrate::a_videos_lines_make_a_camera_without_clicks", &["court", "cameras"]),
    ]),
    ("calibrate", &[
        ("calibrate::clicks_on_a_court_become_a_camera_that_localises", &["points", "out", "json", "list"]),
        ("cameras::a_calibration_takes_intrinsics_and_lens_of_another_tools_file", &["camera"]),
        ("options::calibrate_estimates_what_it_is_told_to", &["estimate"]),
        ("calibrate::a_videos_lines_make_four_clicks_exact", &["refine-lines"]),
        ("calibrate::a_videos_lines_make_a_camera_without_clicks", &["court", "overlay"]),
    ]),
    ("camera import", &[
        ("cameras::the_cameras_of_kalibr_take_their_pose_from_another_file", &["to"]),
        ("cameras::each_tools_camera_sees_what_its_tool_says", &["units", "world", "size", "pose", "image", "json"]),
        ("options::a_camera_of_four_coefficients_is_what_is_said_of_it", &["lens"]),
        ("cameras::wrong_axes_and_an_inverted_pose_are_doubted", &["scene"]),
    ]),
    ("label", &[
        ("options::track_and_label_take_camera_ball_numbers_model_and_device", &["out", "scene", "model", "device"]),
        ("label::the_command_turns_a_folder_of_frames_into_a_track_or_into_cvats_xml", &["camera", "fps", "format"]),
        ("label::the_command_turns_a_clips_folder_into_a_labelled_one", &["json"]),
    ]),
    ("import", &[
        ("options::import_attaches_the_scene_cuts_clips_and_finds_pictures_elsewhere", &["from", "out", "camera", "scene", "fps", "pictures", "clip-frames", "json"]),
        ("import_track::a_labelled_video_becomes_a_track_with_radii", &["track", "category"]),
        ("import_track::several_balls_are_named_and_one_can_be_chosen", &["object"]),
    ]),
    ("synth", &[
        ("options::synth_draws_what_its_options_say", &["set", "out", "size", "label-noise", "disturb", "depth", "sheet", "seed"]),
        ("cli::a_synthetic_set_is_gone_on_with_after_a_kill_and_can_be_read", &["split", "clips", "json"]),
        ("cli::a_build_without_mujoco_says_how_to_get_one", &["engine"]),
        ("flights::flights_are_drawn_into_a_video_and_cut_into_stacks", &["videos", "balls"]),
    ]),
    ("train", &[
        ("cli::a_training_that_is_killed_goes_on_to_the_same_weights", &["config", "out", "set", "resume"]),
        ("options::train_starts_from_a_preset_on_the_folders_that_are_given", &["preset", "train", "validation"]),
        ("options::train_says_what_it_made_and_where_it_cannot_run", &["device", "json", "no-report"]),
        ("options::train_prints_the_whole_configuration", &["print"]),
    ]),
    ("adapt", &[
        ("adapt::a_model_learns_a_ball_from_two_flights_and_finds_more_of_it", &["camera", "scene", "out", "rounds", "steps", "seed", "json"]),
        ("adapt::one_flight_is_not_enough_and_nothing_is_written", &["ball"]),
        ("adapt::what_cannot_be_is_refused_before_anything_is_tracked", &["model", "device", "seed-label", "fps", "court", "camera-sigma", "assume-phone"]),
    ]),
    ("evaluate", &[
        ("cli::evaluate_prints_the_metrics_of_the_contract", &["data", "model", "json"]),
        ("options::evaluate_scores_what_it_is_told_to", &["device", "only", "bins", "z-min", "z-max", "record"]),
        ("options::saliency_and_evaluate_take_the_ball_that_is_given", &["ball-radius", "ball"]),
        ("cli::evaluate_writes_a_report_and_says_how_fast_it_was", &["report", "log"]),
    ]),
    ("saliency", &[
        ("cli::saliency_is_strongest_around_the_ball", &["camera", "out", "model", "json"]),
        ("options::saliency_and_evaluate_take_the_ball_that_is_given", &["ball-radius", "ball"]),
    ]),
    ("fit", &[
        ("cli::fit_finds_the_trajectory_of_a_track_with_gaps", &["track", "camera", "scene", "fps", "out", "json"]),
        ("options::fit_counts_in_noise_camera_and_what_the_scene_does_not_know", &["camera-sigma", "noise-px", "estimate"]),
        ("cli::fit_of_an_unknown_spin_says_whether_it_knows_how_far_away_the_ball_is", &["ball", "plot"]),
        ("options::fit_makes_no_more_hits_than_are_allowed", &["hits"]),
        ("cli::fit_takes_the_numbers_that_it_says_it_judged_by", &["config"]),
    ]),
    ("forecast", &[
        ("cli::forecast_prints_states_and_jacobians", &["scene", "state", "times", "jacobian", "json"]),
        ("cli::forecast_fills_in_the_reference_cases", &["cases"]),
        ("options::forecast_is_as_exact_as_its_tolerance_and_solves_numerically_on_request", &["tolerance", "numeric"]),
    ]),
    ("batch", &[
        ("batch::what_is_done_is_not_done_again_and_what_fails_stops_nothing", &["shard", "out"]),
    ]),
];

#[test]
fn every_option_of_every_subcommand_is_checked_by_a_test() {
    let mut options = BTreeSet::new();
    let mut commands = vec![(String::new(), Arguments::command())];
    while let Some((name, command)) = commands.pop() {
        for argument in command.get_arguments().filter(|argument| !argument.is_hide_set()) {
            options.extend(argument.get_long().map(|long| format!("{name} --{long}")));
        }
        let inner = command.get_subcommands().filter(|inner| !inner.is_hide_set());
        commands.extend(inner.map(|inner| (format!("{name} {}", inner.get_name()).trim().into(), inner.clone())));
    }
    let checked = CHECKED.iter().flat_map(|(name, tests)| {
        tests.iter().flat_map(move |(_, longs)| longs.iter().map(move |long| format!("{name} --{long}")))
    });
    let checked: BTreeSet<String> = checked.collect();
    let missing: Vec<&String> = options.symmetric_difference(&checked).collect();
    assert!(missing.is_empty(), "in the table or in the command alone: {missing:?}");
}

#[test]
fn the_tests_that_the_table_names_pass_the_options() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/all");
    for (name, tests) in CHECKED {
        let subcommand = name.split(' ').next().unwrap();
        for (test, longs) in tests {
            let (file, function) = test.split_once("::").unwrap();
            let text = std::fs::read_to_string(folder.join(file).with_extension("rs")).unwrap();
            assert!(text.contains(&format!("#[test]\nfn {function}()")), "{test} is no test");
            assert!(text.contains(&format!("\"{subcommand}\"")), "{test} never calls {subcommand}");
            for long in *longs {
                let passed = [format!("\"--{long}\""), format!("\"--{long}=")];
                assert!(passed.iter().any(|option| text.contains(option)), "{test} does not pass --{long}");
            }
        }
    }
}
