//! `diptych devices`.

use crate::device::{self, AdapterReport, Selection};
use crate::report::text_table;

use super::failure::Failure;
use super::hints;

#[derive(clap::Args)]
pub struct Args {
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// Opens a device if the adapter lacks nothing else, since drivers may list adapters on which none can be opened.
fn try_to_open(adapter: &mut AdapterReport) {
    let selection = Selection { adapters: Some(vec![adapter.index]), virtual_devices: 1, ..Default::default() };
    if adapter.missing.is_empty()
        && let Err(error) = device::open(&selection)
    {
        let cause = std::error::Error::source(&error).map_or_else(|| error.to_string(), ToString::to_string);
        adapter.missing.push(format!("a device that can be opened ({cause})"));
        adapter.hint = "update its driver or choose another adapter";
    }
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let mut adapters = device::adapters();
    adapters.iter_mut().for_each(try_to_open);
    if args.json {
        let text = serde_json::to_string_pretty(&adapters).map_err(anyhow::Error::from)?;
        say!("{text}");
        return Ok(());
    }
    if adapters.is_empty() {
        return Err(device::DeviceError::NoAdapter.into());
    }
    let rows: Vec<_> = adapters
        .iter()
        .map(|a| {
            let state = if a.missing.is_empty() {
                "ready".into()
            } else {
                format!("lacks {}: {} ({})", a.missing.join(", "), a.hint, hints::ADAPTER)
            };
            vec![
                a.index.to_string(),
                a.name.clone(),
                a.kind.clone(),
                a.backend.clone(),
                a.driver.clone(),
                format!("{} MiB", a.max_storage_mib),
                if a.ray_queries { "yes" } else { "no" }.to_owned(),
                state,
            ]
        })
        .collect();
    let headers = ["#", "adapter", "kind", "backend", "driver", "largest buffer", "ray queries", "state"];
    say!("{}", text_table(&headers, &rows).trim_end());
    for (adapter, advice) in adapters.iter().filter_map(|a| Some((a, a.advice.as_ref()?))) {
        say!("\nadapter {}: {advice}", adapter.index);
    }
    Ok(())
}
