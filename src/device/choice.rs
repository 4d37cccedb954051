//! Selects default adapters: each GPU once, even if several APIs and drivers list it.

use wgpu::{AdapterInfo, Backend, DeviceType};

/// Returns the indices of the default adapters: all GPUs, each through the API that [`rank`] prefers. Without a GPU,
/// returns one software adapter.
pub fn by_default(adapters: &[&AdapterInfo]) -> Vec<usize> {
    let mut ranked: Vec<usize> = (0..adapters.len()).collect();
    ranked.sort_by_key(|&i| rank(adapters[i].backend));
    let mut gpus: Vec<Gpu> = Vec::new();
    for &i in ranked.iter().filter(|&&i| is_gpu(adapters[i])) {
        let info = adapters[i];
        let same = gpus.iter_mut().filter(|gpu| gpu.is_listed_as(adapters[gpu.chosen], info));
        match same.min_by_key(|gpu| !is_same_place(adapters[gpu.chosen], info)) {
            Some(gpu) => gpu.backends.push(info.backend),
            None => gpus.push(Gpu { chosen: i, backends: vec![info.backend] }),
        }
    }
    let mut chosen: Vec<usize> = gpus.iter().map(|gpu| gpu.chosen).collect();
    if chosen.is_empty() {
        chosen.extend(ranked.first());
    }
    chosen.sort_unstable();
    chosen
}

/// A selected GPU.
struct Gpu {
    /// Index of the adapter that represents it.
    chosen: usize,
    /// APIs that have listed it so far.
    backends: Vec<Backend>,
}

impl Gpu {
    /// Returns true if `other` is another listing of this GPU; `chosen` is the adapter that represents the GPU. One API
    /// lists each of several identical cards, so `other` is this GPU if the model is the same and the API of `other`
    /// has not listed this GPU yet. Two Vulkan drivers may list the same card; then the PCI bus decides. It cannot
    /// decide on DirectX 12, where wgpu reports the bus of the first card of a model for all of them.
    fn is_listed_as(&self, chosen: &AdapterInfo, other: &AdapterInfo) -> bool {
        let has_listed = self.backends.contains(&other.backend);
        is_same_model(chosen, other)
            && (!has_listed || other.backend == Backend::Vulkan && is_same_place(chosen, other))
    }
}

fn is_gpu(info: &AdapterInfo) -> bool {
    matches!(info.device_type, DeviceType::DiscreteGpu | DeviceType::IntegratedGpu | DeviceType::VirtualGpu)
}

/// Returns the rank of an API by preference, 0 being the best. Vulkan precedes Metal: where both list a GPU, Vulkan is
/// a layer on top of Metal.
fn rank(backend: Backend) -> u8 {
    match backend {
        Backend::Vulkan => 0,
        Backend::Metal => 1,
        Backend::Dx12 => 2,
        Backend::Gl | Backend::BrowserWebGpu | Backend::Noop => 3,
    }
}

/// Returns true if both adapters are the same GPU model. Compares names if an adapter has no device number: Metal and
/// OpenGL report none, and OpenGL adds words to the name.
fn is_same_model(a: &AdapterInfo, b: &AdapterInfo) -> bool {
    if a.device != 0 && b.device != 0 {
        return (a.vendor, a.device) == (b.vendor, b.device);
    }
    let [a, b] = [a, b].map(|info| info.name.to_lowercase());
    !a.is_empty() && !b.is_empty() && (a.contains(&b) || b.contains(&a))
}

fn is_same_place(a: &AdapterInfo, b: &AdapterInfo) -> bool {
    !a.device_pci_bus_id.is_empty() && a.device_pci_bus_id == b.device_pci_bus_id
}

#[cfg(test)]
mod tests {
    use super::*;

    const GEFORCE: (u32, u32, &str) = (0x10de, 0x2484, "NVIDIA GeForce RTX 3070");
    const INTEL: (u32, u32, &str) = (0x8086, 0x3e92, "Intel(R) UHD Graphics 630");
    const RADEON: (u32, u32, &str) = (0x1002, 0x73bf, "AMD Radeon RX 6800 XT");

    fn adapter(backend: Backend, (vendor, device, name): (u32, u32, &str), bus: &str) -> AdapterInfo {
        let fake = AdapterInfo::new(DeviceType::DiscreteGpu, backend);
        AdapterInfo { vendor, device, name: name.to_owned(), device_pci_bus_id: bus.to_owned(), ..fake }
    }

    fn software(backend: Backend, name: &str) -> AdapterInfo {
        AdapterInfo { device_type: DeviceType::Cpu, ..adapter(backend, (0x10005, 0, name), "") }
    }

    #[track_caller]
    fn assert_chosen(adapters: &[AdapterInfo], expected: &[usize]) {
        assert_eq!(by_default(&adapters.iter().collect::<Vec<_>>()), expected);
    }

    #[test]
    fn gpu_listed_by_two_apis_is_chosen_once() {
        let [vulkan, dx12] = [Backend::Vulkan, Backend::Dx12].map(|api| adapter(api, GEFORCE, "0000:01:00.0"));
        assert_chosen(&[vulkan.clone(), dx12.clone()], &[0]);
        assert_chosen(&[dx12.clone(), vulkan.clone()], &[1]);
        let nowhere = AdapterInfo { device_pci_bus_id: String::new(), ..dx12.clone() };
        assert_chosen(&[vulkan.clone(), nowhere], &[0]);
        let gl = adapter(Backend::Gl, (0x10de, 0, "NVIDIA GeForce RTX 3070/PCIe/SSE2"), "");
        assert_chosen(&[gl.clone(), dx12, vulkan], &[2]);
        assert_chosen(&[gl], &[0]);
    }

    #[test]
    fn two_equal_gpus_are_both_chosen() {
        let vulkan = ["0000:01:00.0", "0000:02:00.0"].map(|bus| adapter(Backend::Vulkan, GEFORCE, bus));
        assert_chosen(&vulkan, &[0, 1]);
        // DirectX 12 reports the first card's bus for both, or no bus.
        for bus in ["0000:01:00.0", ""] {
            let dx12 = [bus; 2].map(|bus| adapter(Backend::Dx12, GEFORCE, bus));
            assert_chosen(&dx12, &[0, 1]);
            assert_chosen(&[&dx12[..], &vulkan].concat(), &[2, 3]);
            assert_chosen(&[&vulkan[..1], &dx12, &vulkan[1..]].concat(), &[0, 3]);
        }
        let unplaced = ["", ""].map(|bus| adapter(Backend::Vulkan, GEFORCE, bus));
        assert_chosen(&unplaced, &[0, 1]);
        let metal = [Backend::Metal; 2].map(|api| adapter(api, (0, 0, "AMD Radeon Pro W6800X"), ""));
        assert_chosen(&metal, &[0, 1]);
    }

    /// A GPU without a Vulkan driver is listed by the next API.
    #[test]
    fn gpu_is_chosen_from_the_first_api_that_lists_it() {
        let vulkan = adapter(Backend::Vulkan, GEFORCE, "0000:02:00.0");
        let dx12 = [
            adapter(Backend::Dx12, INTEL, "0000:00:02.0"),
            adapter(Backend::Dx12, GEFORCE, "0000:01:00.0"),
            adapter(Backend::Dx12, GEFORCE, "0000:01:00.0"),
        ];
        assert_chosen(&[&[vulkan][..], &dx12].concat(), &[0, 1, 3]);
    }

    #[test]
    fn gpu_listed_by_two_vulkan_drivers_is_chosen_once() {
        let drivers = ["0000:03:00.0", "0000:03:00.0", "0000:04:00.0"].map(|bus| adapter(Backend::Vulkan, RADEON, bus));
        assert_chosen(&drivers, &[0, 2]);
    }

    #[test]
    fn software_is_chosen_only_without_gpus() {
        let [gl, vulkan] = [Backend::Gl, Backend::Vulkan].map(|api| software(api, "llvmpipe"));
        assert_chosen(&[gl.clone(), vulkan.clone()], &[1]);
        assert_chosen(&[vulkan.clone(), vulkan.clone()], &[0]);
        assert_chosen(&[vulkan, adapter(Backend::Vulkan, INTEL, ""), gl], &[1]);
        assert_chosen(&[], &[]);
    }
}
