//! `diptych bench --report`: pictures of settings on the Pareto front, time against error, and other renderers for
//! comparison.

use anyhow::Context;

use crate::report::Table;
use crate::report::bench::{
    ERROR_NOTE, KIND_NOTE, Regret, SettingRow, Shared, Slope, exposure_note, kind_table, ladder_svg, ladder_table,
    regret_table, table, undecided_note,
};
use crate::report::html::Section;
use crate::report::lanes::LaneFrame;
use crate::report::peers::{self, Peer};
use crate::report::pictures::{Group, Picture, viewer};
use diptych::control::Ladder;
use diptych::device::DeviceInfo;
use diptych::exec::{FrameReport, PerView};
use diptych::image::RgbImage;
use diptych::loaded::LoadedScene;
use diptych::metrics::kinds::Kind;
use diptych::metrics::rivalry::Differences;
use diptych::quality::Denoiser;

use super::args::Args;
use super::grid::Grid;
use super::judge;
use super::reference::Reference;
use crate::failure::Failure;
use crate::page;

/// A setting on the Pareto front, rendered again for its picture and for the timeline of its tasks.
struct Seen {
    name: String,
    linear: PerView<RgbImage>,
    frame: FrameReport,
}

/// Contents of the report page.
pub struct Page<'a> {
    pub args: &'a Args,
    pub loaded: &'a LoadedScene,
    pub reference: &'a Reference,
    pub devices: &'a [DeviceInfo],
    pub peers: &'a [Peer],
    pub rows: &'a [SettingRow],
    pub slopes: &'a [Slope],
    pub regrets: &'a [Regret],
    pub ladder: &'a Ladder,
}

impl Page<'_> {
    /// Writes the page. `figure` is the plot of time against the error, `shared` lists the settings that all rows share.
    pub fn write(&self, grid: &Grid, figure: String, shared: Shared) -> Result<(), Failure> {
        let Self { args, rows, reference, .. } = self;
        let options = &args.options;
        let title = format!("Time against error, {} at {}", options.shot, options.settings.size);
        let seen = self.seen(grid)?;
        let noise = reference.noise.as_ref();
        let errors =
            "Means over frames, by eye, and the 95 % interval of the time over turns. Front: the intervals show \
                      no other setting to be faster and better."
                .to_owned();
        let front = Section {
            heading: "Time against error",
            notes: [errors, ERROR_NOTE.to_owned(), exposure_note(self.loaded.exposure_ev())]
                .into_iter()
                .chain(undecided_note(rows))
                .chain(self.slopes.iter().map(ToString::to_string))
                .collect(),
            table: Some(table(rows, noise)),
            figure: Some(figure),
        };
        let frames: Vec<LaneFrame> = seen.iter().map(|s| LaneFrame::new(s.name.clone(), &s.frame)).collect();
        let note =
            "The last frame of each setting that is pictured above, rendered once more for this page.".to_owned();
        let lanes = page::swimlanes(note, &frames, frames.len().saturating_sub(1), None)?;
        let mut notes = vec![format!("Reference: {}.", reference.origin)];
        notes.extend(noise.map(|noise| format!("Its noise (smaller errors mean nothing): {noise}.")));
        let settings = shared.into_iter().map(|(name, value)| vec![name.to_owned(), value]);
        let settings = Some(Table { headers: vec!["setting", "value"], rows: settings.collect() });
        let mut sections = vec![self.pictures(&seen)?, self.ladder()?];
        sections.extend(self.beside_peers());
        sections.extend(self.regret());
        sections.extend(self.by_kind()?);
        sections.extend(self.rivalry(&seen)?);
        sections.extend([
            front,
            lanes,
            Section { heading: "Settings", notes, table: settings, figure: None },
            Section { heading: "Devices", table: Some(Table::of_devices([self.devices])), ..Section::default() },
            page::scene(options, self.loaded),
        ]);
        page::write(&options.out, &title, &sections)
    }

    /// Renders the fastest, the middle and the best setting of the front again, without duplicates.
    fn seen(&self, grid: &Grid) -> Result<Vec<Seen>, Failure> {
        let mut front: Vec<&SettingRow> = self.rows.iter().filter(|r| r.on_front).collect();
        front.sort_by(|a, b| a.measured.time_ms.total_cmp(&b.measured.time_ms));
        let last = front.len().saturating_sub(1);
        let mut places = vec![("fastest", 0), ("middle", last / 2), ("best", last)];
        places.dedup_by_key(|(_, place)| *place);
        let rows = places.into_iter().filter_map(|(which, place)| Some((which, *front.get(place)?)));
        let seen = rows.map(|(which, row)| {
            let (frame, linear) = grid.show(&row.quality)?;
            Ok(Seen { name: format!("{which}: {}", row.quality), linear, frame })
        });
        seen.collect()
    }

    fn pictures(&self, seen: &[Seen]) -> Result<Section, Failure> {
        let Self { reference, loaded, .. } = self;
        let against = |s: &Seen| page::against(s.name.clone(), &s.linear, &reference.images, loaded);
        let mut groups = seen.iter().map(against).collect::<Result<Vec<_>, _>>()?;
        groups.push(Group::of_frame("reference".into(), &reference.images, loaded.shot.exposure_ev));
        let note = format!("The ends and the middle of the front, and the reference: {}. ", reference.origin);
        page::pictures(note + &page::flip_note(loaded), &groups)
    }

    fn ladder(&self) -> Result<Section, Failure> {
        let title = format!("Fronts of {} at {}", self.args.options.shot, self.args.options.settings.size);
        let figure = ladder_svg(title, self.rows, self.peers, self.ladder).context("cannot draw the fronts")?;
        let rungs = self.ladder.rungs().len();
        let notes = format!(
            "ladder.toml has {rungs} rungs, all with {}, the denoiser with the best front. It omits settings that are \
             less than 3 % apart in time, or that save little time for much error.",
            Denoiser::name_of(self.ladder.rungs()[0].quality.denoiser())
        );
        let table = Some(ladder_table(self.ladder));
        Ok(Section { heading: "Fronts and quality ladder", notes: vec![notes], table, figure: Some(figure) })
    }

    fn by_kind(&self) -> Result<Option<Section>, Failure> {
        let Some(maps) = &self.reference.kinds else { return Ok(None) };
        let eyes = ["left eye", "right eye"].iter().zip(maps);
        let pictures = eyes.map(|(name, map)| Picture { name: (*name).to_owned(), image: map.picture() }).collect();
        let colours = Kind::ALL.map(|kind| {
            format!("{} #{:02x}{:02x}{:02x}", kind.name(), kind.colour()[0], kind.colour()[1], kind.colour()[2])
        });
        let group = Group { name: "kinds of pixels".to_owned(), pictures };
        let figure = viewer(&[group]).context("cannot make the map of kinds")?;
        let notes = vec![KIND_NOTE.to_owned(), format!("Colours of the map: {}.", colours.join(", "))];
        let table = Some(kind_table(self.rows, maps));
        Ok(Some(Section { heading: "Errors by kind of pixel", notes, table, figure: Some(figure) }))
    }

    fn rivalry(&self, seen: &[Seen]) -> Result<Option<Section>, Failure> {
        let Some(in_right) = &self.reference.in_right else { return Ok(None) };
        let picture = |s: &Seen| -> Result<Picture, Failure> {
            let [left, right] = judge::pairs(self.loaded, &self.reference.images, &s.linear)?;
            let image = Differences::new(&left, &right, in_right)?.map();
            Ok(Picture { name: s.name.clone(), image })
        };
        let pictures = seen.iter().map(picture).collect::<Result<_, Failure>>()?;
        let figure =
            viewer(&[Group { name: "rivalry".to_owned(), pictures }]).context("cannot make the maps of rivalry")?;
        let note = "The error of each pixel of the left eye, minus that of the right eye's pixel that shows the same \
                    surface, in the colours of FLIP maps; pixels without such a pixel are grey. Errors that the eyes \
                    share are black. The table of errors has the root mean square after FLIP's contrast filters, \
                    rivalry_seen, and bench.csv the other measures.";
        let notes = vec![note.to_owned()];
        Ok(Some(Section { heading: "Rivalry between the eyes", notes, table: None, figure: Some(figure) }))
    }

    fn regret(&self) -> Option<Section> {
        let path = self.args.ladder.as_ref()?;
        let note = "Regret: a rung's FLIP + flicker, minus the lowest of all settings that take no longer, within 3 %."
            .to_owned();
        let notes = vec![format!("Ladder: {}.", path.display()), note];
        Some(Section { heading: "Regret", notes, table: Some(regret_table(self.regrets)), figure: None })
    }

    fn beside_peers(&self) -> Option<Section> {
        let path = self.args.options.settings.peers.as_ref()?;
        let notes = vec![format!("Peers: {}.", path.display()), peers::NOTE.to_owned()];
        let table = Some(peers::table(self.peers, self.rows));
        Some(Section { heading: "Time to reach the FLIP of each peer", notes, table, figure: None })
    }
}
