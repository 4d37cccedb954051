//! Results of `diptych render`, as it prints them.

use crate::options::RenderOptions;
use crate::report::run::RunReport;

/// Prints the results and the output folder.
pub fn conclude(options: &RenderOptions, views: usize, report: &RunReport) {
    let median = report.median_makespan_ms();
    if options.json {
        let mut result = serde_json::json!({
            "event": "result", "out": options.out.display().to_string(),
            "warm_up_s": report.warm_up_s, "warm_up_frames": report.warm_up_frames,
            "median_makespan_ms": median, "devices_left": report.devices_left(),
        });
        if !report.references.is_empty() {
            result["references"] = serde_json::json!(report.references);
        }
        say!("{result}");
    } else if !options.quiet {
        for reference in &report.references {
            say!("{reference}");
            reference.noise.iter().for_each(|noise| say!("standard error of the mean: {noise}"));
        }
        if let Some(rays_per_s) = report.rays_per_s() {
            let devices = match (report.devices_left(), report.devices.len()) {
                (left, all) if left < all => format!("{left} of {all}"),
                (_, all) => all.to_string(),
            };
            let in_flight = options.settings.frames_in_flight;
            let pace = match report.median_interval_ms(in_flight).filter(|_| in_flight > 1) {
                Some(interval_ms) => format!(", a frame every {interval_ms:.1} ms"),
                None => String::new(),
            };
            let n = report.warm_up_frames;
            let spp = report.frames.last().map_or(0.0, |frame| frame.quality.spp.mean());
            let all = if report.frames.len() == 1 {
                format!(", {} spp in all", f64::from(n + 1) * spp)
            } else {
                String::new()
            };
            let history = if n > 0 { format!(" with {n} frame(s) of history{all}") } else { String::new() };
            say!(
                "warm-up {:.1} s{history}; {} frame(s) of {} on {devices} device(s): median makespan {median:.1} ms{pace}, \
                 {:.2} Mrays/s",
                report.warm_up_s,
                report.frames.len(),
                report.scene.name,
                rays_per_s * 1e-6,
            );
        }
        if let Some((done, all)) = report.frames.last().and_then(|frame| Some((frame.spp_done?, frame.quality.spp))) {
            say!("ended early: the picture has {done} of {all} samples per pixel");
        }
        let between: Vec<u64> = report.frames.iter().filter_map(|frame| frame.bytes_between_ranks).collect();
        if !between.is_empty() {
            let mean = between.iter().sum::<u64>() as f64 / between.len() as f64;
            say!("rows between ranks: {:.1} kB a frame", mean * 1e-3);
        }
        if let Some(right_eye) = report.frames.last().and_then(|frame| frame.right_eye.as_ref()) {
            let whose = if views == 2 { "right eye" } else { "reprojected views" };
            say!("{whose}{}: {right_eye}", if report.frames.len() > 1 { " of the last frame" } else { "" });
        }
        report.rectified.iter().for_each(|rectified| say!("{rectified}"));
        say!("pictures, run.json and frames.csv: {}", options.out.display());
        options.say_trace();
    }
}
