//! Shows images in [tev](https://github.com/Tom94/tev), a viewer to which other programs send images.

use std::collections::BTreeSet;
use std::io;
use std::net::{TcpStream, ToSocketAddrs};
use std::time::Duration;

use anyhow::Context;
use tev_client::{PacketCreateImage, PacketUpdateImage, TevClient};

use super::failure::Failure;
use diptych::image::Extent;

/// Address at which tev listens by default.
const ADDRESS: &str = "127.0.0.1:14158";
/// Time to wait for tev, when connecting and for each packet.
const PATIENCE: Duration = Duration::from_secs(5);
/// Values per packet at most, unless a row has more.
const PACKET_VALUES: usize = 1 << 18;

/// Returns the address of tev: that of the environment variable `TEV`, or its default.
pub fn address() -> String {
    std::env::var("TEV").unwrap_or_else(|_| ADDRESS.to_owned())
}

/// A connection to tev.
pub struct Viewer {
    client: TevClient,
    created: BTreeSet<String>,
}

impl Viewer {
    /// Connects to the viewer at `HOST:PORT`.
    ///
    /// # Errors
    /// [`Failure::Run`] if nothing listens there.
    pub fn connect(address: &str) -> Result<Self, Failure> {
        let connect = || -> io::Result<TcpStream> {
            let mut failed = io::Error::new(io::ErrorKind::NotFound, "the host is unknown");
            for place in address.to_socket_addrs()? {
                match TcpStream::connect_timeout(&place, PATIENCE) {
                    Ok(stream) => return stream.set_write_timeout(Some(PATIENCE)).map(|()| stream),
                    Err(error) => failed = error,
                }
            }
            Err(failed)
        };
        let stream = connect()
            .with_context(|| format!("cannot reach tev at {address}: start it first, or set TEV to its HOST:PORT"));
        Ok(Self { client: TevClient::wrap(stream.map_err(Failure::Run)?), created: BTreeSet::new() })
    }

    /// Shows an image, in place of an earlier one of this name. Each channel has a value per pixel.
    ///
    /// # Errors
    /// [`Failure::Run`] if the connection is lost.
    pub fn show(&mut self, name: &str, extent: Extent, channels: &[(&str, &[f32])]) -> Result<(), Failure> {
        self.send(name, extent, channels).context("cannot send images to tev").map_err(Failure::Run)
    }

    fn send(&mut self, name: &str, Extent { width, height }: Extent, channels: &[(&str, &[f32])]) -> io::Result<()> {
        let names: Vec<&str> = channels.iter().map(|(name, _)| *name).collect();
        if self.created.insert(name.to_owned()) {
            let image = PacketCreateImage { image_name: name, grab_focus: false, width, height, channel_names: &names };
            self.client.send(image)?;
        }
        let rows = (PACKET_VALUES / (width as usize * names.len()).max(1)).max(1) as u32;
        for y in (0..height).step_by(rows as usize) {
            let rows = rows.min(height - y);
            let pixels = (y * width) as usize..((y + rows) * width) as usize;
            let data: Vec<f32> = channels.iter().flat_map(|(_, plane)| &plane[pixels.clone()]).copied().collect();
            let offsets: Vec<u64> = (0..names.len()).map(|channel| (channel * pixels.len()) as u64).collect();
            self.client.send(PacketUpdateImage {
                image_name: name,
                grab_focus: false,
                channel_names: &names,
                channel_offsets: &offsets,
                channel_strides: &vec![1; names.len()],
                x: 0,
                y,
                width,
                height: rows,
                data: &data,
            })?;
        }
        Ok(())
    }
}
