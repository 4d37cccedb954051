// Renders one auxiliary image per dispatch, from the hit at the pixel's centre. If the G-buffer follows mirrors, the
// centre's ray is traced again, since most auxiliary images show the mirrors themselves.

//!include frame grid projection rng tables scene trace reflectance parameters surface split path pack samples motion
//!include last_surface mirrored mirror first_surface bindings

fn centre_hit(pixel: vec2<u32>, hit: vec4<u32>) -> FirstHit {
    let direction = ray_of(pass_.view, vec2<f32>(pixel) + frame.camera.centre);
    return first_hit(Hit(0.0, hit.x, bitcast<vec2<f32>>(hit.yz)), frame.camera.views[pass_.view].origin, direction);
}

// Value of the auxiliary image `kind` that depends on the surface's material: base colour, diffuse or specular albedo.
fn material_value(kind: u32, s: Surface, hit: vec4<u32>, to_viewer: vec3<f32>) -> vec3<f32> {
    switch kind {
        case BASE_COLOR: {
            return parameters_at(placed(hit.x).row, bitcast<vec2<f32>>(hit.yz), stored_material(s.material)).base;
        }
        case DIFFUSE_ALBEDO: {
            return s.diffuse;
        }
        default: {
            let towards = layer_albedo(dot(s.normal, to_viewer), s.roughness).towards;
            return mix(s.f0 * towards.x + s.f90 * towards.y, vec3<f32>(1.0), s.coat);
        }
    }
}

// Screen position, in pixels, at which `eye` sees `p`.
fn on_screen(p: vec3<f32>, eye: View) -> vec2<f32> {
    return pinhole_point(p - eye.origin, eye, vec2<f32>(f32(pass_.args.width), f32(pass_.args.height))).xy;
}

// Screen position, in pixels, at which this frame sees `p`. If the image is not polar, this is the centre of the pixel
// itself, `centre`.
fn seen_at(p: vec3<f32>, centre: vec2<f32>) -> vec2<f32> {
    if IS_POLAR {
        return on_screen(p, frame.camera.views[pass_.view]);
    }
    return centre;
}

// The surface that the pixel shows in mirrors and behind clear glass, whether the denoiser follows these or not. It is 0
// if the pixel shows the sky or a light, unless glass before it reflects: then it is the glass.
fn shown_value(kind: u32, pixel: vec2<u32>) -> vec3<f32> {
    let ahead = ray_of(pass_.view, vec2<f32>(pixel) + frame.camera.centre);
    let rng = rng_for(pixel, pass_.view, 0u);
    let seen = shown_surface(pass_.view, primary_hit(pass_.view, ahead, rng), ahead, rng, 1u);
    let shown = seen.first;
    if (shown.hit.prim & SPHERE) != 0u {
        return vec3<f32>(0.0);
    }
    if kind == SHOWN_NORMAL {
        return shown.surface.normal;
    }
    let image = frame.camera.views[pass_.view].origin + ahead * seen.links.surface_distance;
    return select(image, shown.surface.position, kind == SHOWN_POSITION) + frame.geometry.world_origin;
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    if is_outside(pixel) {
        return;
    }
    let at = pixel_index(pixel);
    var hit = hit_image[at];
    var depth = emission_image[at].a;
    if HAS_MIRRORS {
        let direction = ray_of(pass_.view, vec2<f32>(pixel) + frame.camera.centre);
        let first = primary_hit(pass_.view, direction, rng_for(pixel, pass_.view, 0u));
        hit = vec4<u32>(first.prim, bitcast<vec2<u32>>(first.bary), hit.w);
        depth = select(first.t, 0.0, first.prim == NO_PRIM);
    }
    var value = vec3<f32>(0.0);
    switch pass_.args.kind {
        case ALBEDO: {
            value = unpack_albedo(albedo_image[at]).all;
            // The packed albedo may be rounded, filtered or that of another surface, so recompute it from the surface.
            if HAS_MIRRORS || HAS_POLISH || samples_of(pixel) == 1u {
                let first = centre_hit(pixel, hit);
                let is_followed = (flags_of(first) & (MIRROR | CLEAR_GLASS | POLISHED)) != 0u;
                value = select(value, first.albedo, samples_of(pixel) == 1u || is_followed);
            }
        }
        case EMISSION: {
            value = emission_image[at].rgb;
        }
        case DEPTH: {
            value = vec3<f32>(depth);
        }
        case ROUGHNESS: {
            value = vec3<f32>(unpack_albedo(albedo_image[at]).roughness);
            if (HAS_GLOSS || HAS_MIRRORS) && (hit.x & SPHERE) == 0u {
                value = vec3<f32>(centre_hit(pixel, hit).surface.roughness);
            }
        }
        case HOLES: {
            value = vec3<f32>(f32(hole_reason(tally_image[at])));
        }
        case SPP: {
            value = vec3<f32>(select(f32(samples_of(pixel)), 0.0, hole_reason(tally_image[at]) == SKIPPED));
        }
        case STRIPES: {
            value = vec3<f32>(f32(pass_.device));
        }
        case HISTORY: {
            // The denoiser counts no frames. If it does, `history_length` writes the image.
            value = vec3<f32>(0.0);
        }
        case SHOWN_POSITION, SHOWN_NORMAL, VIRTUAL_POSITION: {
            value = shown_value(pass_.args.kind, pixel);
        }
        default: {
            let centre = vec2<f32>(pixel) + frame.camera.centre;
            let direction = ray_of(pass_.view, centre);
            let origin = frame.camera.views[pass_.view].origin;
            if (hit.x & SPHERE) == 0u {
                let s = surface_at(hit.x, bitcast<vec2<f32>>(hit.yz), origin, direction);
                if pass_.args.kind >= BASE_COLOR {
                    value = material_value(pass_.args.kind, s, hit, -direction);
                } else if pass_.args.kind == NORMAL {
                    value = s.normal;
                } else if pass_.args.kind == POSITION {
                    value = s.position + frame.geometry.world_origin;
                } else {
                    var was_at = s.position;
                    if HAS_MOTION {
                        was_at = last_surface(hit.x, bitcast<vec2<f32>>(hit.yz), s.position, s.normal).position;
                    }
                    let motion = vec3<f32>(on_screen(was_at, previous.views[pass_.view]) - seen_at(s.position, centre), 0.0);
                    value = select(motion, was_at + frame.geometry.world_origin, pass_.args.kind == LAST_POSITION);
                }
            } else if hit.x != NO_PRIM {
                let p = origin + direction * depth;
                let light = stored_light(hit.x & ~SPHERE);
                if pass_.args.kind >= BASE_COLOR {
                    value = vec3<f32>(0.0);
                } else if pass_.args.kind == NORMAL {
                    value = normalize(p - light.position);
                } else if pass_.args.kind == POSITION || pass_.args.kind == LAST_POSITION {
                    value = p + frame.geometry.world_origin;
                } else {
                    value = vec3<f32>(on_screen(p, previous.views[pass_.view]) - seen_at(p, centre), 0.0);
                }
            }
        }
    }
    aov[at] = vec4<f32>(value, 1.0);
}
