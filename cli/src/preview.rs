//! The picture so far of a run that takes long, for `--also preview`.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use crate::failure::Failure;
use diptych::exec::PerView;
use diptych::image::display::{DisplayImage, write_png};
use diptych::image::stereo;

/// File name of the picture so far.
const NAME: &str = "preview.png";

/// Minimum interval between two pictures.
const INTERVAL: Duration = Duration::from_secs(1);

/// File of the picture so far. It is removed at the end of the run, whose pictures replace it.
pub struct Preview {
    path: PathBuf,
    /// Time from which the next picture is written.
    due: Mutex<Instant>,
}

impl Preview {
    pub fn new(folder: &Path) -> Self {
        Self { path: folder.join(NAME), due: Mutex::new(Instant::now()) }
    }

    /// Writes the picture that `read` returns, unless the last one is recent.
    pub fn show(&self, read: impl FnOnce() -> Result<PerView<DisplayImage>, Failure>) -> Result<(), Failure> {
        let mut due = self.due.lock().unwrap_or_else(PoisonError::into_inner);
        if Instant::now() < *due {
            return Ok(());
        }
        write_png(&self.path, &stereo::outer(read()?.values())?)?;
        *due = Instant::now() + INTERVAL;
        Ok(())
    }
}

impl Drop for Preview {
    fn drop(&mut self) {
        // There is no file if the run was short.
        let _ = std::fs::remove_file(&self.path);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use diptych::image::{Extent, Image};

    #[test]
    fn preview_is_written_at_intervals_until_the_end() {
        let folder = tempfile::tempdir().unwrap();
        let picture = || Image::filled(Extent::new(4, 2), [9; 3]);
        let preview = Preview::new(folder.path());
        preview.show(|| Ok(PerView::both(picture(), picture()))).ok().unwrap();
        assert!(folder.path().join(NAME).is_file());
        preview.show(|| panic!("the last picture is recent")).ok().unwrap();
        drop(preview);
        assert!(!folder.path().join(NAME).exists());
    }
}
