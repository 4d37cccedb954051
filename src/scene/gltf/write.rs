//! Writes a scene's geometry and materials as one plain `.glb`: floats and 32-bit indices, embedded PNG images, and one
//! node per instance. Lights, environment and cameras are left to the shot file.

use std::collections::BTreeSet;
use std::io::{self, Write};
use std::path::Path;

use ::image::codecs::png::PngEncoder;
use ::image::{ExtendedColorType, ImageEncoder};
use glam::{Affine2, Affine3A, Mat4, Vec2, Vec3};
use serde_json::{Value, json};

use crate::image::file::atomic_write;
use crate::scene::{
    AlphaMode, Anisotropy, Clearcoat, DiffuseTransmission, Instance, Iridescence, Material, Mesh, NormalMap, Scene,
    SceneError, Sheen, TexelImage, Texture, TextureRef, Volume, Wrap,
};

const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;

/// Writes a file that [`load`](super::load) reads as the same scene, without its lights, environment and cameras.
///
/// # Errors
/// [`SceneError::Image`] if the file cannot be written, [`SceneError::Invalid`] if it exceeds the 4 GiB that a `.glb`
/// can hold.
pub fn write(path: &Path, scene: &Scene) -> Result<(), SceneError> {
    let invalid = |what: String| SceneError::Invalid { path: path.display().to_string(), what };
    let (mut text, mut bin) = chunks(scene).map_err(|e| invalid(format!("cannot encode an image as PNG: {e}")))?;
    text.resize(text.len().next_multiple_of(4), b' ');
    bin.resize(bin.len().next_multiple_of(4), 0);
    let (header, chunk_header) = (12, 8);
    let total = header + chunk_header + text.len() + chunk_header + bin.len();
    let total = u32::try_from(total).map_err(|_| invalid(format!("it takes {total} bytes, but a .glb holds 4 GiB")))?;
    Ok(atomic_write(path, |file| {
        file.write_all(b"glTF")?;
        file.write_all(&2u32.to_le_bytes())?;
        file.write_all(&total.to_le_bytes())?;
        for (kind, bytes) in [(b"JSON", text), (b"BIN\0", bin)] {
            file.write_all(&(bytes.len() as u32).to_le_bytes())?;
            file.write_all(kind)?;
            file.write_all(&bytes)?;
        }
        Ok(())
    })?)
}

/// Returns the JSON and the binary chunk.
fn chunks(scene: &Scene) -> io::Result<(Vec<u8>, Vec<u8>)> {
    let mut draft = Draft::default();
    let images = scene.images.iter().map(|i| draft.image(i)).collect::<io::Result<_>>()?;
    let materials = scene.materials.iter().map(|m| draft.material(m)).collect();
    let meshes = scene.meshes.iter().map(|m| draft.mesh(m)).collect();
    let samplers = scene.textures.iter().map(sampler).collect();
    let texture = |(i, t): (usize, &Texture)| json!({ "source": t.image, "sampler": i });
    let node = |Instance { mesh, world_from_local }: &Instance| match *world_from_local == Affine3A::IDENTITY {
        true => json!({ "mesh": mesh }),
        false => json!({ "mesh": mesh, "matrix": Mat4::from(*world_from_local).to_cols_array() }),
    };
    let mut root = json!({
        "asset": { "version": "2.0", "generator": concat!("diptych ", env!("CARGO_PKG_VERSION")) },
        "scene": 0,
        "scenes": [{ "name": scene.name, "nodes": (0..scene.instances.len()).collect::<Vec<_>>() }],
        "buffers": [{ "byteLength": draft.bin.len() }],
    });
    let lists: [(&str, Vec<Value>); 9] = [
        ("nodes", scene.instances.iter().map(node).collect()),
        ("meshes", meshes),
        ("materials", materials),
        ("textures", scene.textures.iter().enumerate().map(texture).collect()),
        ("samplers", samplers),
        ("images", images),
        ("accessors", draft.accessors),
        ("bufferViews", draft.views),
        ("extensionsUsed", draft.extensions.into_iter().map(Value::from).collect()),
    ];
    // The format forbids empty lists.
    for (name, list) in lists.into_iter().filter(|(_, list)| !list.is_empty()) {
        root[name] = list.into();
    }
    Ok((serde_json::to_vec(&root)?, draft.bin))
}

/// Binary chunk and JSON lists of a file under construction.
#[derive(Default)]
struct Draft {
    bin: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    extensions: BTreeSet<&'static str>,
}

impl Draft {
    fn view(&mut self, bytes: &[u8]) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        self.views.push(json!({ "buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len() }));
        self.bin.extend_from_slice(bytes);
        self.views.len() - 1
    }

    fn accessor<T: bytemuck::NoUninit>(&mut self, kind: &str, component: u32, elements: &[T]) -> usize {
        let view = self.view(bytemuck::cast_slice(elements));
        self.accessors
            .push(json!({ "bufferView": view, "componentType": component, "count": elements.len(), "type": kind }));
        self.accessors.len() - 1
    }

    fn mesh(&mut self, mesh: &Mesh) -> Value {
        let position = self.accessor("VEC3", FLOAT, &mesh.positions);
        let bounds = |pick: fn(Vec3, Vec3) -> Vec3| mesh.positions.iter().copied().reduce(pick).unwrap_or_default();
        self.accessors[position]["min"] = json!(bounds(Vec3::min).to_array());
        self.accessors[position]["max"] = json!(bounds(Vec3::max).to_array());
        let mut attributes = json!({ "POSITION": position });
        if !mesh.normals.is_empty() {
            attributes["NORMAL"] = self.accessor("VEC3", FLOAT, &mesh.normals).into();
        }
        for (name, values) in [("TANGENT", &mesh.tangents), ("COLOR_0", &mesh.colors)] {
            if !values.is_empty() {
                attributes[name] = self.accessor("VEC4", FLOAT, values).into();
            }
        }
        for (name, uvs) in ["TEXCOORD_0", "TEXCOORD_1"].into_iter().zip(&mesh.uvs) {
            if !uvs.is_empty() {
                attributes[name] = self.accessor("VEC2", FLOAT, uvs).into();
            }
        }
        let indices = self.accessor("SCALAR", UNSIGNED_INT, mesh.triangles.as_flattened());
        json!({ "primitives": [{ "attributes": attributes, "indices": indices, "material": mesh.material }] })
    }

    fn image(&mut self, image: &TexelImage) -> io::Result<Value> {
        let mut png = Vec::new();
        PngEncoder::new(&mut png)
            .write_image(image.pixels.as_flattened(), image.extent.width, image.extent.height, ExtendedColorType::Rgba8)
            .map_err(io::Error::other)?;
        Ok(json!({ "bufferView": self.view(&png), "mimeType": "image/png" }))
    }

    fn material(&mut self, m: &Material) -> Value {
        let mut pbr = json!({
            "baseColorFactor": m.base_color.to_array(), "metallicFactor": m.metallic, "roughnessFactor": m.roughness,
        });
        self.texture(&mut pbr, "baseColorTexture", m.base_color_texture);
        self.texture(&mut pbr, "metallicRoughnessTexture", m.metallic_roughness_texture);
        // A power of two, so that the product of factor and strength is exact.
        let strength = m.emissive.max_element().max(1.0).log2().ceil().exp2().min(f32::MAX);
        let mut json = json!({
            "name": m.name, "pbrMetallicRoughness": pbr, "doubleSided": m.double_sided,
            "emissiveFactor": (m.emissive / strength).to_array(),
        });
        self.normal_map(&mut json, "normalTexture", m.normal_map);
        self.texture(&mut json, "emissiveTexture", m.emissive_texture);
        match m.alpha_mode {
            AlphaMode::Opaque => {}
            AlphaMode::Blend => json["alphaMode"] = "BLEND".into(),
            AlphaMode::Mask { cutoff } => {
                json["alphaMode"] = "MASK".into();
                json["alphaCutoff"] = cutoff.into();
            }
        }
        let mut extensions = if m.unlit { vec![("KHR_materials_unlit", json!({}))] } else { self.layers(m) };
        if strength > 1.0 {
            extensions.push(("KHR_materials_emissive_strength", json!({ "emissiveStrength": strength })));
        }
        for (name, extension) in extensions {
            self.extensions.insert(name);
            json["extensions"][name] = extension;
        }
        json
    }

    /// Returns the extensions that change a material's scattering.
    fn layers(&mut self, m: &Material) -> Vec<(&'static str, Value)> {
        let mut layers = Vec::new();
        let mut specular = json!({ "specularFactor": m.specular, "specularColorFactor": m.specular_color.to_array() });
        self.texture(&mut specular, "specularTexture", m.specular_texture);
        self.texture(&mut specular, "specularColorTexture", m.specular_color_texture);
        if specular != json!({ "specularFactor": 1.0, "specularColorFactor": [1.0, 1.0, 1.0] }) {
            layers.push(("KHR_materials_specular", specular));
        }
        if m.ior != 1.5 {
            layers.push(("KHR_materials_ior", json!({ "ior": m.ior })));
        }
        if m.transmission > 0.0 {
            let mut transmission = json!({ "transmissionFactor": m.transmission });
            self.texture(&mut transmission, "transmissionTexture", m.transmission_texture);
            layers.push(("KHR_materials_transmission", transmission));
        }
        if let Some(Volume { attenuation_color, attenuation_distance }) = m.volume {
            // The geometry defines the volume's thickness; a factor above 0 only enables the volume.
            let mut volume = json!({ "thicknessFactor": 1.0, "attenuationColor": attenuation_color.to_array() });
            if attenuation_distance.is_finite() {
                volume["attenuationDistance"] = attenuation_distance.into();
            }
            layers.push(("KHR_materials_volume", volume));
        }
        if m.clearcoat.factor > 0.0 {
            let Clearcoat { factor, factor_texture, roughness, roughness_texture, normal_map } = m.clearcoat;
            let mut coat = json!({ "clearcoatFactor": factor, "clearcoatRoughnessFactor": roughness });
            self.texture(&mut coat, "clearcoatTexture", factor_texture);
            self.texture(&mut coat, "clearcoatRoughnessTexture", roughness_texture);
            self.normal_map(&mut coat, "clearcoatNormalTexture", normal_map);
            layers.push(("KHR_materials_clearcoat", coat));
        }
        if m.diffuse_transmission.factor > 0.0 {
            let DiffuseTransmission { factor, factor_texture, color, color_texture } = m.diffuse_transmission;
            let mut through =
                json!({ "diffuseTransmissionFactor": factor, "diffuseTransmissionColorFactor": color.to_array() });
            self.texture(&mut through, "diffuseTransmissionTexture", factor_texture);
            self.texture(&mut through, "diffuseTransmissionColorTexture", color_texture);
            layers.push(("KHR_materials_diffuse_transmission", through));
        }
        if m.dispersion > 0.0 {
            layers.push(("KHR_materials_dispersion", json!({ "dispersion": m.dispersion })));
        }
        if m.is_anisotropic() {
            let Anisotropy { strength, rotation, texture } = m.anisotropy;
            let mut brushed = json!({ "anisotropyStrength": strength, "anisotropyRotation": rotation });
            self.texture(&mut brushed, "anisotropyTexture", texture);
            layers.push(("KHR_materials_anisotropy", brushed));
        }
        if m.iridescence.factor > 0.0 {
            let Iridescence { factor, factor_texture, ior, thickness_nm: [least, most], thickness_texture } =
                m.iridescence;
            let mut film = json!({
                "iridescenceFactor": factor,
                "iridescenceIor": ior,
                "iridescenceThicknessMinimum": least,
                "iridescenceThicknessMaximum": most,
            });
            self.texture(&mut film, "iridescenceTexture", factor_texture);
            self.texture(&mut film, "iridescenceThicknessTexture", thickness_texture);
            layers.push(("KHR_materials_iridescence", film));
        }
        if m.sheen.is_there() {
            let Sheen { color, color_texture, roughness, roughness_texture } = m.sheen;
            let mut sheen = json!({ "sheenColorFactor": color.to_array(), "sheenRoughnessFactor": roughness });
            self.texture(&mut sheen, "sheenColorTexture", color_texture);
            self.texture(&mut sheen, "sheenRoughnessTexture", roughness_texture);
            layers.push(("KHR_materials_sheen", sheen));
        }
        layers
    }

    fn normal_map(&mut self, json: &mut Value, key: &str, map: Option<NormalMap>) {
        self.texture(json, key, map.map(|m| m.texture));
        if let Some(map) = map {
            json[key]["scale"] = map.scale.into();
        }
    }

    fn texture(&mut self, json: &mut Value, key: &str, texture: Option<TextureRef>) {
        const TRANSFORM: &str = "KHR_texture_transform";
        let Some(TextureRef { texture, uv_set, uv_from_uv }) = texture else { return };
        json[key] = json!({ "index": texture, "texCoord": uv_set });
        if uv_from_uv != Affine2::IDENTITY {
            self.extensions.insert(TRANSFORM);
            json[key]["extensions"][TRANSFORM] = transform(uv_from_uv);
        }
    }
}

/// Returns the JSON of `KHR_texture_transform` for a transform. It applies scale, then rotation, then translation. A
/// counter-clockwise rotation maps +u towards -v.
fn transform(Affine2 { matrix2, translation }: Affine2) -> Value {
    let (u, v) = (matrix2.x_axis, matrix2.y_axis);
    let rotation = if u.length() > 0.0 { (-u.y).atan2(u.x) } else { v.x.atan2(v.y) };
    let (sin, cos) = rotation.sin_cos();
    json!({ "offset": translation.to_array(), "rotation": rotation, "scale": [u.length(), v.dot(Vec2::new(sin, cos))] })
}

fn sampler(texture: &Texture) -> Value {
    let wrap = |wrap: Wrap| match wrap {
        Wrap::Repeat => 10497,
        Wrap::MirroredRepeat => 33648,
        Wrap::ClampToEdge => 33071,
    };
    let filter = if texture.linear { 9729 } else { 9728 };
    json!({ "magFilter": filter, "minFilter": filter, "wrapS": wrap(texture.wrap_u), "wrapT": wrap(texture.wrap_v) })
}
