//! The passes of a frame in order, with consistency checks and the properties derived from their declarations.

use std::borrow::Cow;
use std::collections::HashMap;

use super::halo::Seam;
use super::pass::{Chain, Partition, Pass};
use super::resource::{Format, Image, Life, Resource, Scope};
use super::task::{Task, TaskKind};
use super::uses::Use;
use crate::image::Extent;
use crate::scene::rig::Eye;

/// The passes of a frame.
#[derive(Clone, Debug)]
pub struct Program {
    /// The extent of the frame.
    pub extent: Extent,
    /// The views on which passes run, from left to right.
    eyes: Vec<Eye>,
    passes: Vec<Linked>,
    /// The images that passes bind, without duplicates.
    images: Vec<Bound>,
    partition_sets: Vec<Vec<Partition>>,
}

/// A pass with the properties derived from the passes around it.
#[derive(Clone, Debug)]
pub struct Linked {
    pub pass: Pass,
    /// Index of each use's image in [`Program::images`].
    pub images: Vec<usize>,
    /// Number of rows above and below its stripe that a device also computes, because its later passes read them.
    pub margin_rows: u32,
    /// Index of the pass among the [`Chain::Planned`] passes of its view, which may receive halo rows; `None` for any
    /// other pass.
    pub link: Option<usize>,
}

/// Buffer that a pass binds: one of a resource's buffers, with the contents of this frame or of the previous one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Bound {
    pub resource: Resource,
    /// Index of the buffer: versions alternate between 0 and 1.
    pub buffer: u8,
    pub is_before: bool,
}

impl Bound {
    /// The name in reports.
    pub fn name(&self) -> Cow<'static, str> {
        if self.is_before { format!("last_{}", self.resource.name).into() } else { self.resource.name.into() }
    }
}

/// Contradiction between the declarations of passes.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ProgramError {
    #[error("{stage} reads {image}, which no pass before it has written")]
    Unwritten { stage: &'static str, image: &'static str },
    #[error("{stage} reads version {read} of {image}, but version {held} has overwritten it")]
    Overwritten { stage: &'static str, image: &'static str, read: u8, held: u8 },
    #[error("{stage} reads {image} of the previous frame, but no pass writes it")]
    NeverKept { stage: &'static str, image: &'static str },
    #[error(
        "{stage} reads rows of {image} that another device may have written, but {image} is never transferred between devices"
    )]
    Elsewhere { stage: &'static str, image: &'static str },
    #[error("{stage} writes {image}, but one of the two is per view and the other per device")]
    Scope { stage: &'static str, image: &'static str },
    #[error("{stage} writes {image}, which only the host may write")]
    Input { stage: &'static str, image: &'static str },
    #[error("{stage} computes margin rows on a different grid from the pass that reads them")]
    Grid { stage: &'static str },
}

impl Program {
    /// Links passes, which must be in an order that respects every dependency.
    ///
    /// # Errors
    /// [`ProgramError`] if the declarations contradict one another.
    pub fn new(extent: Extent, seam: Seam, mut passes: Vec<Pass>) -> Result<Self, ProgramError> {
        let mut eyes: Vec<Eye> = passes.iter().filter(|p| p.scope == Scope::View).map(|p| p.view).collect();
        eyes.sort_unstable();
        eyes.dedup();
        let main = eyes.first().copied().unwrap_or(Eye::LEFT).main();
        passes.iter_mut().filter(|p| p.scope == Scope::Device).for_each(|p| p.view = main);
        check(&passes)?;
        let mut numbers: HashMap<Bound, usize> = HashMap::new();
        let mut images = Vec::new();
        let mut number = |bound: Bound| {
            *numbers.entry(bound).or_insert_with(|| {
                images.push(bound);
                images.len() - 1
            })
        };
        let link = |pass: Pass| {
            let of = |image: Image, is_before| Bound { resource: image.resource, buffer: image.buffer(), is_before };
            let images = pass.uses.iter().map(|u| number(of(u.image, u.is_before))).collect();
            Linked { pass, images, margin_rows: 0, link: None }
        };
        let mut passes: Vec<Linked> = passes.into_iter().map(link).collect();
        eyes.iter().try_for_each(|view| add_margins(&mut passes, *view, seam))?;
        let partition_sets = partition_sets(&passes);
        Ok(Self { extent, eyes, passes, images, partition_sets })
    }

    /// Returns the views on which passes run, from left to right.
    pub fn eyes(&self) -> &[Eye] {
        &self.eyes
    }

    /// Returns the number of views of the rig, including those on which no pass runs.
    pub fn views(&self) -> usize {
        self.main_eye().views()
    }

    /// Returns the view whose images are those that all views share.
    pub fn main_eye(&self) -> Eye {
        self.eyes.first().copied().unwrap_or(Eye::LEFT).main()
    }

    /// Returns the passes in order.
    pub fn passes(&self) -> &[Linked] {
        &self.passes
    }

    /// Returns the images that passes bind, without duplicates.
    pub fn images(&self) -> &[Bound] {
        &self.images
    }

    /// Returns sets of partitions (groups of passes with the same stripes), in order of execution. Devices wait for one
    /// another between two sets, so the stripes of each set should make all devices end it at the same time.
    pub fn partition_sets(&self) -> &[Vec<Partition>] {
        &self.partition_sets
    }

    /// Returns the number of passes of a view that may receive halo rows.
    pub fn links(&self) -> usize {
        self.passes.iter().filter_map(|p| p.link).max().map_or(0, |last| last + 1)
    }

    /// Returns the indices of the frame's output images.
    pub fn outputs(&self) -> impl Iterator<Item = usize> {
        let is_output = |b: &Bound| b.resource.life == Life::Output && b.resource.scope == Scope::View && !b.is_before;
        self.images.iter().enumerate().filter(move |(_, b)| is_output(b)).map(|(number, _)| number)
    }

    /// Returns the number of bytes that a download or an upload transfers; 0 for other tasks.
    pub fn bytes(&self, task: &Task) -> u64 {
        match task.kind {
            TaskKind::Download { image, .. } | TaskKind::Upload { image, .. } => {
                self.images[image].resource.row_bytes(self.extent) * u64::from(task.rows.end - task.rows.start)
            }
            TaskKind::Dispatch { .. } | TaskKind::Stitch => 0,
        }
    }

    /// Returns the group of the last pass that writes a resource of a view.
    pub fn writer(&self, resource: &Resource, view: Eye) -> Option<Partition> {
        let writes = |p: &&Linked| {
            p.pass.view == view && p.pass.uses.iter().any(|u| u.access.writes() && u.image.resource == *resource)
        };
        self.passes.iter().rev().find(writes).map(|p| p.pass.partition)
    }
}

/// Checks all rules of [`ProgramError`] except the one on grids: for example, that every pass reads only images that
/// earlier passes have written.
fn check(passes: &[Pass]) -> Result<(), ProgramError> {
    let mut held: HashMap<(Resource, u8, Eye), (u8, Partition)> = HashMap::new();
    let all_writes: Vec<Resource> =
        passes.iter().flat_map(|p| &p.uses).filter(|u| u.access.writes()).map(|u| u.image.resource).collect();
    for pass in passes {
        let stage = pass.stage.name();
        for used in &pass.uses {
            let Image { resource, version } = used.image;
            let image = resource.name;
            if used.is_before {
                if !used.is_optional && !all_writes.contains(&resource) {
                    return Err(ProgramError::NeverKept { stage, image });
                }
                continue;
            }
            if used.access.writes() && resource.life == Life::Input {
                return Err(ProgramError::Input { stage, image });
            }
            if used.access.writes() && resource.scope != pass.scope {
                return Err(ProgramError::Scope { stage, image });
            }
            if !used.is_read() {
                continue;
            }
            match held.get(&(resource, used.image.buffer(), pass.eye_of(used))) {
                None if used.is_optional => {}
                None => return Err(ProgramError::Unwritten { stage, image }),
                Some((held, _)) if *held != version => {
                    return Err(ProgramError::Overwritten { stage, image, read: version, held: *held });
                }
                Some((_, group)) => {
                    let leaves = *group != pass.partition || used.reach.halo_rows() > 0;
                    if resource.life == Life::Local && leaves {
                        return Err(ProgramError::Elsewhere { stage, image });
                    }
                }
            }
        }
        for used in pass.uses.iter().filter(|u| u.access.writes()) {
            let Image { resource, version } = used.image;
            held.insert((resource, used.image.buffer(), pass.eye_of(used)), (version, pass.partition));
        }
    }
    Ok(())
}

/// Sets [`Linked::link`] and [`Linked::margin_rows`] of the passes in a view's filter chain.
fn add_margins(passes: &mut [Linked], view: Eye, seam: Seam) -> Result<(), ProgramError> {
    let in_chain = |p: &&mut Linked| p.pass.view == view && p.pass.chain != Chain::No;
    let mut chain: Vec<&mut Linked> = passes.iter_mut().filter(in_chain).collect();
    let mut links = 0;
    for linked in &mut chain {
        if linked.pass.chain == Chain::Planned {
            linked.link = Some(links);
            links += 1;
        }
    }
    let receives = |link: Option<usize>| match (seam, link) {
        (Seam::Halo(plan), Some(link)) => link == 0 || plan.receives_before(link),
        (Seam::Halo(_), None) => false,
        (Seam::None | Seam::Filter, _) => true,
    };
    let (mut margin, mut grid) = (0, None);
    for linked in chain.iter_mut().rev() {
        if margin > 0 && grid != Some(linked.pass.grid) {
            return Err(ProgramError::Grid { stage: linked.pass.stage.name() });
        }
        linked.margin_rows = margin;
        grid = Some(linked.pass.grid);
        margin = if receives(linked.link) { 0 } else { margin + linked.pass.halo_rows() };
    }
    // A list has the pixels of all rows that passes behind it compute.
    let widest = chain.iter().map(|linked| linked.margin_rows).max().unwrap_or(0);
    let lists = |used: &Use| used.access.writes() && used.image.resource.format == Format::List;
    chain.iter_mut().filter(|p| p.pass.uses.iter().any(lists)).for_each(|p| p.margin_rows = widest);
    Ok(())
}

/// Splits the partitions into those whose passes all come before the first pass that reads halo rows, and the rest. At
/// that pass devices wait for one another, so the load of each set is balanced separately. Passes that every device runs
/// in full have no stripes.
fn partition_sets(passes: &[Linked]) -> Vec<Vec<Partition>> {
    let first = passes.iter().position(|p| p.pass.halo_rows() > 0).unwrap_or(passes.len());
    let groups = |passes: &[Linked]| {
        let mut groups: Vec<Partition> = Vec::new();
        for pass in passes.iter().map(|p| &p.pass).filter(|p| p.scope == Scope::View) {
            if !groups.contains(&pass.partition) {
                groups.push(pass.partition);
            }
        }
        groups
    };
    let (mut early, late) = (groups(&passes[..first]), groups(&passes[first..]));
    early.retain(|group| !late.contains(group));
    [early, late].into_iter().filter(|set| !set.is_empty()).collect()
}

#[cfg(test)]
mod tests;
