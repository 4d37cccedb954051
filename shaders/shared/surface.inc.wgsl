// Surface at a ray's hit on a triangle: position, normals, and scattering lobes.

//!include frame math tables scene reflectance parameters

override HAS_NORMAL_MAPS: bool = true;
override HAS_SPECULAR: bool = true;
override HAS_TRANSMISSION: bool = true;
override HAS_DIFFUSE_TRANSMISSION: bool = true;
override HAS_CLEARCOAT: bool = true;
override HAS_SHEEN: bool = true;
override HAS_IRIDESCENCE: bool = true;
override HAS_ANISOTROPY: bool = true;
override HAS_DISPERSION: bool = true;
override HAS_UNLIT: bool = true;

struct Surface {
    position: vec3<f32>,
    // Bound of the position's rounding error along the geometric normal.
    error: f32,
    // Normals that face the side the ray came from.
    geometric_normal: vec3<f32>,
    normal: vec3<f32>,
    // Whether the ray came from the triangle's front.
    is_front: bool,
    emission: vec3<f32>,
    material: u32,

    // Fraction of uniform light that is reflected towards the viewer. Radiance is demodulated by it.
    albedo: vec3<f32>,
    // The part of `albedo` that belongs to the wide lobes: Lambert and sheen.
    matte: vec3<f32>,
    // Perceptual roughness; 1 if no lobe could be smooth.
    roughness: f32,
    // GGX width of reflection and transmission. Where it depends on the direction, it is `alpha` across the unit vector
    // `tangent` and `alpha_along`, which is larger, along it.
    alpha: f32,
    alpha_along: f32,
    tangent: vec3<f32>,
    // Colours of diffuse reflection and of the facets' transmission, before the layers above attenuate them.
    diffuse: vec3<f32>,
    transmitted: vec3<f32>,
    // Fraction of the surface under whose facets there is no base: they transmit what they do not reflect.
    clear: f32,
    // Colour of diffuse transmission, and the probability that the diffuse lobe sends a sample there.
    through: vec3<f32>,
    through_odds: f32,
    // Schlick's reflectance of metal and dielectric, mixed: at normal and at grazing incidence.
    f0: vec3<f32>,
    f90: vec3<f32>,
    // Largest channel of the dielectric's reflectance, at normal and at grazing incidence. The lobes beneath the
    // dielectric lose this fraction of the light.
    layer_f0: f32,
    layer_f90: f32,
    // Directional albedo of the dielectric layer towards the viewer, and its mean over directions.
    layer_albedo: f32,
    layer_mean: f32,
    // Index of refraction on the light's side over that on the viewer's, for transmitted light; 1 means no refraction.
    eta: f32,
    // The same for red, green and blue, where they differ.
    etas: vec3<f32>,
    // Probabilities with which `sample_bsdf` follows red, green and blue where they part.
    colors: vec3<f32>,
    is_thin: bool,
    // Fresnel reflectance of the coat, towards the viewer, times its strength.
    coat: f32,
    coat_alpha: f32,
    coat_normal: vec3<f32>,
    // Colour of the sheen, its perceptual roughness, and a white sheen's directional albedo towards the viewer,
    // as published.
    sheen: vec3<f32>,
    sheen_roughness: f32,
    sheen_albedo: f32,
    // Probabilities with which `sample_bsdf` picks a lobe: diffuse, facets (reflection and transmission), coat.
    odds: vec3<f32>,
}

// Whether all surfaces have only the Lambertian lobe.
fn all_are_lambertian() -> bool {
    return !(HAS_SPECULAR || HAS_TRANSMISSION || HAS_DIFFUSE_TRANSMISSION || HAS_CLEARCOAT || HAS_SHEEN);
}

// True if the width of the facets depends on the direction.
fn is_brushed(s: Surface) -> bool {
    return s.alpha_along > s.alpha;
}

struct Tangents {
    t: vec3<f32>,
    b: vec3<f32>,
}

// Tangent and bitangent on the front side, orthogonal to the normal; zero if there are none.
fn tangents_at(place: Placed, bary: vec2<f32>, normal: vec3<f32>) -> Tangents {
    let given = (1.0 - bary.x - bary.y) * tangent_at(place, 0u) + bary.x * tangent_at(place, 1u) + bary.y * tangent_at(place, 2u);
    let along = given.xyz - normal * dot(normal, given.xyz);
    let size2 = dot(along, along);
    let t = select(vec3<f32>(0.0), along * inverseSqrt(max(size2, 1e-30)), size2 > 1e-12);
    return Tangents(t, select(1.0, -1.0, given.w < 0.0) * cross(normal, t));
}

// Applies a normal map on the front side. Without a tangent, the normal stays as it is. A normal that faces away from
// the viewer is bent until it is visible.
fn mapped_normal(place: Placed, bary: vec2<f32>, code: vec3<f32>, scale: f32, normal: vec3<f32>, to_viewer: vec3<f32>) -> vec3<f32> {
    let local = (2.0 * code - 1.0) * vec3<f32>(scale, scale, 1.0);
    let axes = tangents_at(place, bary, normal);
    let mapped = local.x * axes.t + local.y * axes.b + local.z * normal;
    let mapped2 = dot(mapped, mapped);
    let n = select(normal, mapped * inverseSqrt(max(mapped2, 1e-30)), mapped2 > 1e-12);
    const LEAST: f32 = 1e-3;
    let cosine = dot(n, to_viewer);
    return select(n, normalize(n + (LEAST - cosine) * to_viewer), cosine < LEAST);
}

// Direction of the anisotropy, before it is projected onto the tangent plane. `code` holds it along tangent and
// bitangent.
fn brushed_direction(place: Placed, bary: vec2<f32>, code: vec2<f32>, turn: vec2<f32>, normal: vec3<f32>) -> vec3<f32> {
    let local = 2.0 * code - 1.0;
    let axes = tangents_at(place, bary, normal);
    return (turn.x * local.x - turn.y * local.y) * axes.t + (turn.y * local.x + turn.x * local.y) * axes.b;
}

struct Located {
    position: vec3<f32>,
    error: f32,
}

// Half a unit in the last place of 1.
const ROUNDING: f32 = 0x1p-24;

fn unit_normal(tri: Triangle, otherwise: vec3<f32>) -> vec3<f32> {
    let edges = scaled_edges(tri);
    let cross_ = cross(edges.e1, edges.e2);
    let n = cross_ * power_scale(cross_);
    let size = length(n);
    return select(otherwise, n / size, size > 0.0);
}

// Position where the ray hits the triangle, and the bound of its error along the normal, including that of a later test
// of this triangle's plane (Pharr et al., PBRT 4e, 6.8).
//
// There are two methods. Mixing the corners by `bary` costs 7 roundings of their magnitudes (6.8.5) and, along the
// triangle, those of the weights times its edges: on large triangles this destroys a coordinate's last digits.
// Following the ray to the plane and projecting onto it costs roundings of its origin and length, and those of the
// plane's distance, which grow at grazing angles. The method with the smaller bound is used.
fn locate(tri: Triangle, bary: vec2<f32>, ng: vec3<f32>, origin: vec3<f32>, direction: vec3<f32>) -> Located {
    let b0 = 1.0 - bary.x - bary.y;
    let mixed = b0 * tri.v0 + bary.x * tri.v1 + bary.y * tri.v2;
    let magnitude = abs(b0 * tri.v0) + abs(bary.x * tri.v1) + abs(bary.y * tri.v2);
    let edges = scaled_edges(tri);
    let e1 = edges.e1;
    let e2 = edges.e2;
    // The relative error of the normal is 3 roundings of the products that it is made of.
    let products = abs(e1.yzx * e2.zxy) + abs(e1.zxy * e2.yzx);
    let size = length(cross(e1, e2));
    let corner = tri.v0 - origin;
    let cosine = dot(ng, direction);
    let t = dot(ng, corner) / cosine;
    let on_ray = origin + direction * t;
    let projected = on_ray - ng * dot(ng, on_ray - tri.v0);
    let mixed_bound = 7.0 * max3(magnitude) + 6.0 * (products.x + products.y + products.z) / (size * abs(cosine)) * (max3(abs(e1) + abs(e2)) / edges.scale);
    let ray_bound = max3(abs(origin)) + 3.0 * abs(t) + 8.0 * dot(products, abs(corner)) / (size * abs(cosine));
    let is_projected = ray_bound < mixed_bound;
    let position = select(mixed, projected, is_projected);
    // Signed distances from the plane are sums of 3 products of a difference: 4 roundings.
    let plane = 4.0 * dot(abs(ng), abs(position - tri.v0));
    let error = select(14.0 * dot(abs(ng), magnitude), 2.0 * dot(abs(ng), abs(position)) + plane, is_projected) + plane;
    return Located(position, ROUNDING * error);
}

fn surface_at(prim: u32, bary: vec2<f32>, origin: vec3<f32>, direction: vec3<f32>) -> Surface {
    let place = placed(prim);
    let tri = triangle_at(place);
    let shade = shading_at(place);
    let m = stored_material(tri.material);
    let b0 = 1.0 - bary.x - bary.y;
    var s: Surface;
    let ng = unit_normal(tri, -direction);
    let located = locate(tri, bary, ng, origin, direction);
    s.position = located.position;
    s.error = located.error + dot(abs(ng), placing_error(place, located.position));
    var ns = b0 * shade.n0 + bary.x * shade.n1 + bary.y * shade.n2;
    let ns_size = length(ns);
    ns = select(ng, ns / ns_size, ns_size > 1e-12);
    s.is_front = dot(ng, direction) <= 0.0;
    let side = select(-1.0, 1.0, s.is_front);
    s.geometric_normal = side * ng;
    s.normal = select(s.geometric_normal, side * ns, dot(side * ns, direction) < 0.0);
    s.coat_normal = s.normal;
    let p = parameters_at(place.row, bary, m);
    if HAS_ANISOTROPY && m.anisotropy > 0.0 {
        s.tangent = brushed_direction(place, bary, p.brushed.xy, m.anisotropy_direction, side * s.normal);
    }
    if HAS_NORMAL_MAPS {
        // The tangent frame belongs to the front. Seen from behind, all of it is flipped.
        let viewer = -side * direction;
        if (m.flags & NORMAL_MAP) != 0u {
            s.normal = side * mapped_normal(place, bary, p.normal, m.normal_scale, side * s.normal, viewer);
        }
        if HAS_CLEARCOAT && (m.flags & CLEARCOAT_NORMAL_MAP) != 0u {
            s.coat_normal = side * mapped_normal(place, bary, p.coat_normal, m.clearcoat_normal_scale, side * s.coat_normal, viewer);
        }
    }
    s.material = tri.material;
    s.emission = vec3<f32>(0.0);
    if HAS_EMISSIVE {
        if s.is_front || (m.flags & DOUBLE_SIDED) != 0u {
            s.emission = p.emissive;
        }
    }
    describe_lobes(&s, p, m, -direction);
    if HAS_UNLIT && (m.flags & UNLIT) != 0u {
        s.emission = p.base;
        s.albedo = vec3<f32>(0.0);
        s.diffuse = vec3<f32>(0.0);
        s.transmitted = vec3<f32>(0.0);
        s.through = vec3<f32>(0.0);
        s.f0 = vec3<f32>(0.0);
        s.f90 = vec3<f32>(0.0);
        s.coat = 0.0;
        s.sheen = vec3<f32>(0.0);
        s.odds = vec3<f32>(0.0);
    }
    return s;
}

// The lobes of glTF's material model (specification 2.0, appendix B; KHR_materials_ior, _specular, _transmission,
// _volume, _clearcoat, _sheen, _diffuse_transmission,
// _iridescence, _anisotropy, _dispersion) with this hit's textures.
fn describe_lobes(s: ptr<function, Surface>, p: Parameters, m: Material, to_viewer: vec3<f32>) {
    let base = p.base;
    (*s).albedo = base;
    (*s).diffuse = base;
    (*s).roughness = 1.0;
    (*s).eta = 1.0;
    (*s).etas = vec3<f32>(1.0);
    (*s).colors = vec3<f32>(1.0 / 3.0);
    (*s).is_thin = true;
    (*s).odds = vec3<f32>(1.0, 0.0, 0.0);
    if all_are_lambertian() {
        return;
    }
    var roughness = clamp(p.roughness, 0.0, 1.0);
    let metallic = clamp(p.metallic, 0.0, 1.0);
    (*s).alpha = roughness * roughness;
    if HAS_ANISOTROPY {
        (*s).alpha_along = (*s).alpha;
        let strength = clamp(m.anisotropy * p.brushed.z, 0.0, 1.0);
        let along = (*s).tangent - (*s).normal * dot((*s).normal, (*s).tangent);
        let size2 = dot(along, along);
        if strength > 0.0 && size2 > 1e-12 {
            (*s).tangent = along * inverseSqrt(size2);
            (*s).alpha = max((*s).alpha, SMOOTH);
            (*s).alpha_along = mix((*s).alpha, 1.0, strength * strength);
            // The roughness of an isotropic surface whose facets are about as wide.
            roughness = sqrt(sqrt((*s).alpha * (*s).alpha_along));
        }
    }
    let bend = (m.ior - 1.0) / (m.ior + 1.0);
    var layer_f0 = min(bend * bend * p.specular_color, vec3<f32>(1.0));
    var metal_f0 = base;
    if HAS_IRIDESCENCE {
        if p.iridescence > 0.0 {
            let thickness = mix(m.film_thickness.x, m.film_thickness.y, p.film_thickness);
            let cosine = max(dot((*s).normal, to_viewer), 0.0);
            layer_f0 = mix(layer_f0, film_f0(cosine, m.film_ior, thickness, layer_f0), p.iridescence);
            metal_f0 = mix(metal_f0, film_f0(cosine, m.film_ior, thickness, metal_f0), p.iridescence);
        }
    }
    layer_f0 *= p.specular;
    (*s).f0 = mix(layer_f0, metal_f0, metallic);
    (*s).f90 = vec3<f32>(mix(p.specular, 1.0, metallic));
    (*s).layer_f0 = max3(layer_f0);
    (*s).layer_f90 = p.specular;
    let table = layer_albedo(dot((*s).normal, to_viewer), roughness);
    (*s).layer_albedo = (*s).layer_f0 * table.towards.x + (*s).layer_f90 * table.towards.y;
    (*s).layer_mean = (*s).layer_f0 * table.mean.x + (*s).layer_f90 * table.mean.y;
    var transmission = 0.0;
    if HAS_TRANSMISSION {
        transmission = p.transmission;
        (*s).clear = (1.0 - metallic) * transmission;
        (*s).transmitted = (*s).clear * base;
        (*s).is_thin = (m.flags & THICK) == 0u;
        if !(*s).is_thin && m.ior >= 1.0 {
            (*s).eta = select(1.0 / m.ior, m.ior, (*s).is_front);
        }
        if HAS_DISPERSION {
            let iors = vec3<f32>(m.ior - m.dispersion, m.ior, m.ior + m.dispersion);
            (*s).etas = select(vec3<f32>((*s).eta), select(1.0 / iors, iors, (*s).is_front), m.dispersion > 0.0);
        }
    }
    (*s).diffuse = (1.0 - metallic) * (1.0 - transmission) * base;
    if HAS_DIFFUSE_TRANSMISSION {
        (*s).through = (1.0 - metallic) * (1.0 - transmission) * p.through * p.through_color;
        (*s).diffuse *= 1.0 - p.through;
        let both = luminance((*s).diffuse) + luminance((*s).through);
        (*s).through_odds = select(0.0, luminance((*s).through) / both, both > 0.0);
    }
    (*s).roughness = select(roughness, 1.0, (*s).f90.x == 0.0 && transmission == 0.0);
    (*s).albedo = ((*s).diffuse + (*s).transmitted) * (1.0 - (*s).layer_albedo) + (*s).f0 * table.towards.x + (*s).f90 * table.towards.y;
    (*s).matte = (*s).diffuse * (1.0 - (*s).layer_albedo);
    if HAS_DIFFUSE_TRANSMISSION {
        (*s).albedo += (*s).through * (1.0 - (*s).layer_albedo);
        (*s).matte += (*s).through * (1.0 - (*s).layer_albedo);
    }
    if HAS_SHEEN {
        (*s).sheen = p.sheen;
        (*s).sheen_roughness = clamp(p.sheen_roughness, LEAST_SHEEN_ROUGHNESS, 1.0);
        (*s).sheen_albedo = sheen_albedo(dot((*s).normal, to_viewer), (*s).sheen_roughness);
        let sheen = min((*s).sheen_albedo, 1.0);
        let left = 1.0 - max3(p.sheen) * sheen;
        (*s).albedo = (*s).albedo * left + p.sheen * sheen;
        (*s).matte = (*s).matte * left + p.sheen * sheen;
    }
    if HAS_CLEARCOAT {
        let coat_roughness = clamp(p.coat_roughness, 0.0, 1.0);
        (*s).coat_alpha = coat_roughness * coat_roughness;
        (*s).coat = p.coat * mix(schlick_weight(abs(dot((*s).coat_normal, to_viewer))), 1.0, 0.04);
        (*s).emission *= 1.0 - (*s).coat;
        (*s).albedo = mix((*s).albedo, vec3<f32>(1.0), (*s).coat);
        (*s).matte *= 1.0 - (*s).coat;
    }
    (*s).odds = lobe_odds(*s, table.towards.xy);
}

// Probabilities of the lobes, in proportion to the light that each sends to the viewer.
fn lobe_odds(s: Surface, towards: vec2<f32>) -> vec3<f32> {
    let facets = luminance(s.f0) * towards.x + s.f90.x * towards.y;
    let diffuse = luminance(s.diffuse) + select(0.0, luminance(s.through), HAS_DIFFUSE_TRANSMISSION);
    let beneath = vec2<f32>(diffuse, luminance(s.transmitted)) * max(1.0 - s.layer_albedo, 0.05);
    var odds = vec3<f32>(vec2<f32>(beneath.x, facets + beneath.y) * (1.0 - s.coat), s.coat);
    if HAS_SHEEN {
        // The diffuse lobe's directions suit the sheen, which is wide.
        let left = 1.0 - max3(s.sheen) * min(s.sheen_albedo, 1.0);
        let sheen = luminance(s.sheen) * clamp(s.sheen_albedo, 0.05, 1.0);
        odds = vec3<f32>((beneath.x * left + sheen) * (1.0 - s.coat), odds.y * left, odds.z);
    }
    let sum = odds.x + odds.y + odds.z;
    return select(vec3<f32>(0.0), odds / sum, sum > 0.0);
}

// Fraction of light from narrow lobes above which it counts as view-dependent.
const VIEW_DEPENDENT_FRACTION: f32 = 0.1;

// True if the other eye sees a different radiance at this point, because lobes too narrow to reach both eyes contribute
// a significant fraction.
fn is_view_dependent(s: Surface) -> bool {
    const NARROW: f32 = 0.25;
    if all_are_lambertian() {
        return false;
    }
    var is_narrow = s.roughness < NARROW;
    if HAS_ANISOTROPY {
        is_narrow = is_narrow || (is_brushed(s) && s.alpha < NARROW * NARROW);
    }
    let narrow = select(0.0, s.odds.y, is_narrow) + select(0.0, s.odds.z, s.coat_alpha < NARROW * NARROW);
    return narrow > VIEW_DEPENDENT_FRACTION;
}

// Origin of a ray that leaves the surface towards `direction`: the position, offset along the normal by the error
// bound, then rounded away from the surface.
fn leave(s: Surface, direction: vec3<f32>) -> vec3<f32> {
    let n = select(-s.geometric_normal, s.geometric_normal, dot(direction, s.geometric_normal) >= 0.0);
    let moved = s.position + n * s.error;
    let ulp = max(abs(moved) * 1.1920929e-7, vec3<f32>(1e-30));
    return moved + sign(n) * ulp;
}
