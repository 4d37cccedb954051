//! Frames that are sent to a viewer.

use std::collections::BTreeMap;
use std::io::Read;
use std::net::TcpListener;

use diptych::image::exr::{read_channels, read_rgb};

use crate::common::{Folder, Said};

/// Reads values of a packet one after another, in little-endian order.
struct Packet(std::vec::IntoIter<u8>);

impl Packet {
    fn bytes<const N: usize>(&mut self) -> [u8; N] {
        std::array::from_fn(|_| self.0.next().expect("the packet has ended"))
    }

    fn number(&mut self) -> usize {
        u32::from_le_bytes(self.bytes()) as usize
    }

    fn numbers(&mut self, count: usize) -> Vec<usize> {
        (0..count).map(|_| u64::from_le_bytes(self.bytes()) as usize).collect()
    }

    fn text(&mut self) -> String {
        String::from_utf8(self.0.by_ref().take_while(|byte| *byte != 0).collect()).unwrap()
    }
}

/// Planes of images by the name of the image and the channel, as a viewer has them after these packets.
fn images(mut sent: &[u8]) -> BTreeMap<(String, String), Vec<f32>> {
    let (mut planes, mut widths) = (BTreeMap::new(), BTreeMap::new());
    while !sent.is_empty() {
        let length = u32::from_le_bytes(sent[..4].try_into().unwrap()) as usize;
        let mut packet = Packet(Vec::from(&sent[4..length]).into_iter());
        sent = &sent[length..];
        let [kind, _focus] = packet.bytes();
        let image = packet.text();
        match kind {
            // Create.
            4 => {
                let [width, height, channels] = [(); 3].map(|()| packet.number());
                widths.insert(image.clone(), width);
                for _ in 0..channels {
                    let before = planes.insert((image.clone(), packet.text()), vec![f32::NAN; width * height]);
                    assert!(before.is_none(), "{image} is created twice");
                }
            }
            // Update a rectangle.
            6 => {
                let count = packet.number();
                let names: Vec<String> = (0..count).map(|_| packet.text()).collect();
                let [x, y, width, height] = [(); 4].map(|()| packet.number());
                let (offsets, strides) = (packet.numbers(count), packet.numbers(count));
                let data: Vec<f32> = packet.0.as_slice().as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
                for ((name, offset), stride) in names.into_iter().zip(offsets).zip(strides) {
                    let plane = planes.get_mut(&(image.clone(), name)).expect("the image was created");
                    for i in 0..width * height {
                        plane[(y + i / width) * widths[&image] + x + i % width] = data[offset + i * stride];
                    }
                }
            }
            kind => panic!("a packet of the type {kind}"),
        }
    }
    planes
}

#[test]
fn viewer_receives_the_values_of_the_files() {
    let folder = Folder::new();
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let viewer = std::thread::spawn(move || {
        let mut sent = Vec::new();
        listener.accept().unwrap().0.read_to_end(&mut sent).unwrap();
        sent
    });
    let line = "render builtin:checker --also tev --size 48x30 --frames 2 --aov depth,normal --out ./out";
    Said::new(folder.program(line).env("TEV", address.to_string()).output().unwrap()).success(line);
    let planes = images(&viewer.join().unwrap());
    assert_eq!(planes.len(), 2 * (3 + 1 + 3), "{:?}", planes.keys());
    let bits = |values: Vec<f32>| values.into_iter().map(f32::to_bits).collect::<Vec<_>>();
    for eye in ["left", "right"] {
        let plane = |channel: &str| bits(planes[&(format!("builtin:checker {eye}"), channel.to_owned())].clone());
        let image = read_rgb(&folder.path(&format!("out/{eye}.0001.exr"))).unwrap();
        let normal = read_channels(&folder.path(&format!("out/{eye}.normal.0001.exr")), ["X", "Y", "Z"]).unwrap();
        for c in 0..3 {
            let of = |image: &diptych::image::RgbImage| bits(image.pixels.iter().map(|p| p[c]).collect());
            assert!(plane(["R", "G", "B"][c]) == of(&image), "{eye} {c}");
            assert!(plane(["normal.X", "normal.Y", "normal.Z"][c]) == of(&normal.image), "{eye} {c}");
        }
    }
}

#[test]
fn rejects_a_viewer_that_does_not_listen() {
    let folder = Folder::new();
    let free = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    for address in [free.to_string(), "nowhere".to_owned()] {
        let mut command = folder.program("render builtin:checker --also tev --out ./out");
        let said = Said::new(command.env("TEV", &address).output().unwrap());
        assert!(said.status == Some(1) && said.errors.contains(&address), "{}", said.errors);
        assert!(folder.names("out").is_empty());
    }
}
