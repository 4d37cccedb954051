//! No material creates energy, and white materials lose a known fraction.

use std::sync::Mutex;

use super::{Finish, MATTE};
use crate::effort::is_thorough;

const ROUGHNESSES: [f64; 6] = [0.0, 0.1, 0.3, 0.5, 0.7, 1.0];
const COSINES: [f64; 5] = [1.0, 0.7, 0.4, 0.15, 0.03];

/// Returns all relevant combinations of material properties.
fn grid() -> Vec<Finish> {
    let mut all = Vec::new();
    for roughness in ROUGHNESSES {
        for coat in [None, Some(0.0), Some(0.5)] {
            all.push(Finish { roughness, coat, metallic: 1.0, ..MATTE });
            for metallic in [0.0, 0.5] {
                for specular in [0.0, 0.5, 1.0] {
                    for ior in [0.0, 1.0, 1.2, 1.5, 2.5] {
                        let opaque = Finish { roughness, coat, metallic, specular, ior, ..MATTE };
                        all.push(opaque);
                        all.push(Finish { transmission: 0.5, ..opaque });
                        all.push(Finish { transmission: 1.0, ..opaque });
                        all.push(Finish { transmission: 0.5, thick: true, ..opaque });
                        all.push(Finish { transmission: 1.0, thick: true, ..opaque });
                        all.push(Finish { transmission: 1.0, thick: true, on_back: true, ..opaque });
                    }
                }
            }
        }
    }
    for roughness in [0.1, 0.3, 0.5, 0.8] {
        for brushed in [0.4, 0.8, 1.0] {
            let metal = Finish { roughness, brushed, metallic: 1.0, ..MATTE };
            let plastic = Finish { metallic: 0.0, specular: 1.0, ..metal };
            all.extend([metal, plastic, Finish { ior: 2.5, ..plastic }, Finish { ior: 0.0, ..plastic }]);
            let glass = Finish { transmission: 1.0, ..plastic };
            all.extend([glass, Finish { thick: true, ..glass }, Finish { thick: true, on_back: true, ..glass }]);
        }
        let prism = Finish { roughness, dispersion: 0.1, transmission: 1.0, specular: 1.0, thick: true, ..MATTE };
        all.extend([prism, Finish { on_back: true, ..prism }]);
    }
    for roughness in [0.07, 0.2, 0.5, 1.0] {
        let sheen = Some(roughness);
        let cloth = Finish { sheen, ..MATTE };
        all.extend([cloth, Finish { specular: 1.0, ..cloth }, Finish { metallic: 1.0, roughness: 0.3, ..cloth }]);
        all.push(Finish { specular: 1.0, transmission: 1.0, roughness: 0.3, ..cloth });
        all.push(Finish { coat: Some(0.3), ..cloth });
        let leaf = Finish { through: 0.5, specular: 1.0, roughness, ..MATTE };
        all.extend([leaf, Finish { through: 1.0, ..leaf }, Finish { sheen, transmission: 0.5, ..leaf }]);
        all.push(Finish { ior: 2.5, ..leaf });
    }
    all
}

#[test]
fn no_material_makes_light() {
    let step = if is_thorough() { 1 } else { 7 };
    let work = Mutex::new(grid().into_iter().step_by(step));
    // Maxima over materials in general, and over those with an index of 1, whose facets reflect beside straight
    // transmission.
    let brightest = Mutex::new([(0.0, String::new()), (0.0, String::new())]);
    let search = || {
        loop {
            let next = work.lock().unwrap().next();
            let Some(finish) = next else { break };
            let straight = finish.thick && finish.ior <= 1.0 && finish.roughness > 0.0;
            for mu in COSINES {
                let mut albedo = finish.albedo(mu, 128);
                if albedo > 0.98 {
                    albedo = finish.albedo(mu, 4096);
                }
                if albedo > 1.0 {
                    albedo = finish.albedo(mu, 65_536);
                }
                let brightest = &mut brightest.lock().unwrap()[usize::from(straight)];
                if albedo > brightest.0 {
                    *brightest = (albedo, format!("μ {mu}, {finish:?}"));
                }
            }
        }
    };
    let threads = std::thread::available_parallelism().map_or(1, |n| n.get());
    std::thread::scope(|scope| (0..threads).for_each(|_| drop(scope.spawn(search))));
    // Straight transmission is attenuated by F at the macro normal, where rough facets reflect a little more.
    for ((albedo, which), most) in brightest.into_inner().unwrap().into_iter().zip([1.001, 1.005]) {
        println!("largest albedo: {albedo:.5} ({which})");
        assert!(albedo <= most, "{which}: {albedo}");
    }
}

/// Single scattering on white facets loses a known fraction, by roughness and cosine.
#[test]
fn white_furnace_losses() {
    let dielectric = Finish { specular: 1.0, ..MATTE };
    let glass = Finish { transmission: 1.0, ..dielectric };
    let rows = [
        ("dielectric over white", dielectric, 0.25),
        ("dielectric, ior 2.5", Finish { ior: 2.5, ..dielectric }, 0.45),
        ("metal", Finish { metallic: 1.0, ..MATTE }, 0.75),
        ("thin glass", glass, 0.75),
        ("into glass, ior 1.5", Finish { thick: true, ..glass }, 0.75),
        ("out of glass, ior 1.5", Finish { thick: true, on_back: true, ..glass }, 0.85),
        ("coat over white", Finish { coat: Some(0.0), ..MATTE }, 0.75),
    ];
    println!("loss in % at cosines {COSINES:?}");
    for (name, finish, most) in rows {
        println!("{name}");
        for roughness in ROUGHNESSES {
            let finish = Finish { roughness, coat: finish.coat.map(|_| roughness), ..finish };
            let loss = COSINES.map(|mu| 1.0 - finish.albedo(mu, 16_384));
            println!("  roughness {roughness:.1}: {}", loss.map(|l| format!("{:6.2}", 100.0 * l)).join(" "));
            assert!(loss.iter().all(|l| (-0.001..most).contains(l)), "{name}, roughness {roughness}: {loss:?}");
            if roughness == 0.0 && finish.transmission + finish.metallic > 0.0 {
                assert!(loss.iter().all(|l| l.abs() < 1e-3), "{name} is smooth and loses {loss:?}");
            }
        }
    }
}
