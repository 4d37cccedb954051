//! Devices that are lost at any moment, like through their drivers, cause errors and no panic.

use std::time::Duration;

use crate::common::{Stage, Subject, devices_to_lose};
use diptych::exec::ExecError;
use diptych::schedule::Even;

const WIDTH: u32 = 64;
const HEIGHT: u32 = 36;

#[test]
fn rejects_devices_lost_before_the_first_frame() {
    let subject = Subject::load("builtin:checker");
    let settings = subject.accumulated(WIDTH, HEIGHT);
    let gpus = devices_to_lose(1);
    gpus[0].device.destroy();
    match subject.renderer(gpus, &settings) {
        Err(ExecError::Device { device: 0, what }) => assert!(what.contains("lost"), "{what}"),
        Err(other) => panic!("{other}"),
        Ok(_) => panic!("it has been destroyed"),
    }
}

/// Devices are lost at random moments of their frames.
#[test]
fn same_bytes_whenever_a_device_is_lost() {
    let subject = Subject::load("builtin:checker");
    let mut settings = subject.denoised(WIDTH, HEIGHT);
    settings.execution.max_dispatch_ms = Some(1.0);
    let one = Stage::alone(&subject, &settings).frame(0).linear;
    for delay_us in [0, 300, 2_000, 7_000, 15_000, 40_000] {
        let gpus = devices_to_lose(2);
        let lost = gpus[1].device.clone();
        let mut two = Stage::on(gpus, &subject, &settings, Box::new(Even::new(HEIGHT, 2)));
        std::thread::scope(|scope| {
            scope.spawn(move || {
                std::thread::sleep(Duration::from_micros(delay_us));
                lost.destroy();
            });
            for _ in 0..3 {
                assert!(two.frame(0).linear == one, "{delay_us} µs");
            }
        });
        assert!(two.frame(0).linear == one, "{delay_us} µs, afterwards");
        let faults: Vec<_> = two.renderer().faults().iter().map(|f| f.device).collect();
        assert_eq!(faults, [1], "{delay_us} µs");
    }
}

#[test]
fn images_of_a_lost_device_are_rendered_again_or_fail() {
    let subject = Subject::load("builtin:checker");
    let settings = subject.denoised(WIDTH, HEIGHT);
    for count in [1, 2] {
        let gpus = devices_to_lose(count);
        let lost = gpus[0].device.clone();
        let mut stage = Stage::on(gpus, &subject, &settings, Box::new(Even::new(HEIGHT, count)));
        let expected = stage.frame(0).linear;
        lost.destroy();
        match stage.renderer().read_linear() {
            Ok(found) => assert!(count == 2 && found == expected),
            Err(ExecError::NoneLeft { device: 0, what }) => assert!(count == 1 && what.contains("lost"), "{what}"),
            Err(other) => panic!("{other}"),
        }
    }
}
