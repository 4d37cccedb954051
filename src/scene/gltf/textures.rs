//! The materials' textures and images, each read once.

use std::collections::HashMap;
use std::sync::Arc;

use ::gltf::json::extensions::texture::TextureTransform;
use ::gltf::json::texture::{Info, MagFilter, Sampler, Texture as JsonTexture, WrappingMode};
use ::gltf::json::validation::Checked;
use glam::{Affine2, Mat2, Vec2};

use super::buffers::Buffers;
use super::fault::{Fault, Outcome, Warnings, Within, label, lookup};
use super::images;
use super::uri::Target;
use crate::image::Image;
use crate::scene::folder::shorten;
use crate::scene::{TexelImage, Texture, TextureRef, Wrap};

pub struct TextureTable<'a, 'b> {
    buffers: &'a Buffers<'b>,
    pub textures: Vec<Texture>,
    pub images: Vec<Arc<TexelImage>>,
    /// Index in `textures` by the texture's index in the file.
    texture_of: HashMap<usize, usize>,
    /// Index in `images` by location of the encoded bytes; `None` for an image that cannot be read.
    image_of: HashMap<Encoded<'b>, Option<usize>>,
    /// Index in `images` of each image that [`roughness_of`](Self::roughness_of) made, by the index of its source image
    /// and the bits of the glossiness factor.
    roughness_of: HashMap<(usize, u32), usize>,
}

/// Location of an image's encoded bytes. Several images of a file may share one.
#[derive(PartialEq, Eq, Hash)]
enum Encoded<'a> {
    Target(Target<'a>),
    View(usize),
}

impl<'a, 'b> TextureTable<'a, 'b> {
    pub fn new(buffers: &'a Buffers<'b>) -> Self {
        Self {
            buffers,
            textures: Vec::new(),
            images: Vec::new(),
            texture_of: HashMap::new(),
            image_of: HashMap::new(),
            roughness_of: HashMap::new(),
        }
    }

    /// Returns a reference to a texture; `None`, with a warning, if it cannot be used.
    pub fn refer(&mut self, info: &Info, place: &str, warnings: &mut Warnings) -> Outcome<Option<TextureRef>> {
        let transform = info.extensions.as_ref().and_then(|e| e.texture_transform.as_ref());
        let uv_set = transform.and_then(|t| t.tex_coord).unwrap_or(info.tex_coord) as usize;
        if uv_set > 1 {
            warnings.note("textures on coordinate sets above 1 are left out", place);
            return Ok(None);
        }
        let uv_from_uv = transform.map_or(Ok(Affine2::IDENTITY), affine_from)?;
        let texture = self.texture(info.index.value(), place, warnings)?;
        Ok(texture.map(|texture| TextureRef { texture, uv_set, uv_from_uv }))
    }

    /// Converts glossiness in a texture's alpha to a roughness image: 1 - `glossiness` times alpha.
    pub fn roughness_of(&mut self, glossy: TextureRef, glossiness: f32) -> Outcome<TextureRef> {
        let source = self.textures[glossy.texture].image;
        let image = match self.roughness_of.get(&(source, glossiness.to_bits())) {
            Some(&known) => known,
            None => {
                let Image { extent, pixels } = &*self.images[source];
                self.buffers.budget().reserve(size_of_val(&**pixels) as u64)?.keep();
                let rough = |p: &[u8; 4]| (255.0 - glossiness * f32::from(p[3])).round() as u8;
                let pixels = pixels.iter().map(|p| [0, rough(p), 0, 255]).collect();
                self.images.push(Arc::new(Image { extent: *extent, pixels }));
                self.roughness_of.insert((source, glossiness.to_bits()), self.images.len() - 1);
                self.images.len() - 1
            }
        };
        self.textures.push(Texture { image, ..self.textures[glossy.texture] });
        Ok(TextureRef { texture: self.textures.len() - 1, ..glossy })
    }

    fn texture(&mut self, index: usize, place: &str, warnings: &mut Warnings) -> Outcome<Option<usize>> {
        if let Some(&known) = self.texture_of.get(&index) {
            return Ok(Some(known));
        }
        let root = self.buffers.root;
        let texture = lookup(&root.textures, "texture", index)?;
        let Some(source) = source_of(texture) else {
            warnings.note("textures without a readable image are left out", place);
            return Ok(None);
        };
        let within = || label("texture", index, &texture.name);
        let Some(image) = self.image(source, warnings).within(within)? else { return Ok(None) };
        let sampler = match texture.sampler {
            Some(sampler) => {
                let json = lookup(&root.samplers, "sampler", sampler.value()).within(within)?;
                read_sampler(json, &format!("sampler {sampler}"), warnings)
            }
            None => read_sampler(&Sampler::default(), "", warnings),
        };
        self.textures.push(Texture { image, ..sampler });
        self.texture_of.insert(index, self.textures.len() - 1);
        Ok(Some(self.textures.len() - 1))
    }

    /// Returns the index of an image; `None`, with a warning, if its bytes cannot be read, unless faults are to be refused.
    fn image(&mut self, index: usize, warnings: &mut Warnings) -> Outcome<Option<usize>> {
        let image = lookup(&self.buffers.root.images, "image", index)?;
        let place = || match &image.uri {
            Some(uri) if image.name.is_none() => format!("image {index} '{}'", shorten(uri)),
            _ => label("image", index, &image.name),
        };
        let encoded = match (&image.uri, image.buffer_view) {
            (Some(uri), _) => Target::of(uri, self.buffers.folder).map(Encoded::Target),
            (None, Some(view)) => Ok(Encoded::View(view.value())),
            (None, None) => Err(Fault::Invalid("it has neither a URI nor a buffer view".into())),
        };
        const LOST: &str = "images that cannot be read are left out, and materials have their factors alone";
        let strict = self.buffers.folder.access.strict;
        let Some(encoded) = warnings.tolerate(encoded, LOST, &place(), strict)? else { return Ok(None) };
        if let Some(&known) = self.image_of.get(&encoded) {
            return Ok(known);
        }
        let decoded = warnings.tolerate(self.decode(&encoded), LOST, &place(), strict)?;
        let number = decoded.map(|image| {
            self.images.push(Arc::new(image));
            self.images.len() - 1
        });
        self.image_of.insert(encoded, number);
        Ok(number)
    }

    fn decode(&self, encoded: &Encoded) -> Outcome<TexelImage> {
        let budget = self.buffers.budget();
        match encoded {
            Encoded::Target(target) => images::decode(&target.read(self.buffers.folder.access)?, budget),
            Encoded::View(view) => images::decode(self.buffers.view(*view)?.bytes, budget),
        }
    }
}

/// Returns the index of a texture's image: that of `KHR_texture_basisu` or `EXT_texture_webp` if the texture has one, or
/// else its `source`.
fn source_of(texture: &JsonTexture) -> Option<usize> {
    let of = |name: &str| texture.extensions.as_ref()?.others.get(name)?.get("source")?.as_u64();
    let extension = of("KHR_texture_basisu").or_else(|| of("EXT_texture_webp"));
    let extension = extension.and_then(|source| usize::try_from(source).ok());
    // The crate marks a texture without a source by this index.
    let absent = u32::MAX as usize;
    extension.or(Some(texture.source.value()).filter(|&source| source != absent))
}

/// Converts a sampler. The caller sets the [`Texture::image`] of the result, which is 0. Values that glTF does not know
/// count as the default, with a warning.
fn read_sampler(sampler: &Sampler, place: &str, warnings: &mut Warnings) -> Texture {
    let mut is_known = true;
    let mut wrap = |mode: Checked<WrappingMode>| match mode {
        Checked::Valid(WrappingMode::Repeat) => Wrap::Repeat,
        Checked::Valid(WrappingMode::MirroredRepeat) => Wrap::MirroredRepeat,
        Checked::Valid(WrappingMode::ClampToEdge) => Wrap::ClampToEdge,
        Checked::Invalid => {
            is_known = false;
            Wrap::Repeat
        }
    };
    let (wrap_u, wrap_v) = (wrap(sampler.wrap_s), wrap(sampler.wrap_t));
    if !is_known || sampler.mag_filter == Some(Checked::Invalid) {
        warnings.note("samplers have the default for filters and wrap modes that glTF does not know", place);
    }
    let linear = sampler.mag_filter != Some(Checked::Valid(MagFilter::Nearest));
    Texture { image: 0, wrap_u, wrap_v, linear }
}

/// Converts a `KHR_texture_transform`, which applies scale, then rotation, then translation. Since v points down the
/// image, a counter-clockwise rotation maps +u towards -v. The extension's text and examples say so, although its GLSL
/// rotates the other way.
fn affine_from(transform: &TextureTransform) -> Outcome<Affine2> {
    let (sin, cos) = transform.rotation.0.sin_cos();
    let rotation = Mat2::from_cols(Vec2::new(cos, -sin), Vec2::new(sin, cos));
    let scale = Mat2::from_diagonal(Vec2::from_array(transform.scale.0));
    let affine = Affine2::from_mat2_translation(rotation * scale, Vec2::from_array(transform.offset.0));
    if affine.is_finite() { Ok(affine) } else { Err(Fault::Invalid("its KHR_texture_transform is not finite".into())) }
}
