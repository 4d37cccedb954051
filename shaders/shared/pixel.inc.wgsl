// Traces the samples of a pixel that one dispatch covers. The pass binds the images.

//!include frame grid projection rng tables trace split path cells cache bounces pack samples mirrored footprint
//!include first_surface bindings

// Whether the variance of samples is stored along with their mean.
override MEASURES_VARIANCE: bool = false;

// Sums over samples of the luminances of light and albedo, their squares and their product, each for diffuse and
// specular. They yield a mean of light over albedo and its variance (a ratio estimator: Cochran, "Sampling Techniques",
// 1977, chapter 6).
struct Spread {
    light: vec2<f32>,
    albedo: vec2<f32>,
    light_light: vec2<f32>,
    light_albedo: vec2<f32>,
    albedo_albedo: vec2<f32>,
}

// Luminance of albedo up to which it counts as black.
const BLACK_LUMINANCE: f32 = 1e-6;

fn ratio_of(light: vec2<f32>, albedo: vec2<f32>) -> vec2<f32> {
    return select(vec2<f32>(0.0), light / max(albedo, vec2<f32>(BLACK_LUMINANCE)), albedo > vec2<f32>(BLACK_LUMINANCE));
}

// Luminances of diffuse and specular light or albedo as filters see them, clamped so that squares stay finite.
fn two_luminances(matte: vec3<f32>, gloss: vec3<f32>) -> vec2<f32> {
    return min(vec2<f32>(luminance(matte), luminance(gloss)), vec2<f32>(1e16));
}

fn add_sample(s: ptr<function, Spread>, light: vec2<f32>, albedo: vec2<f32>) {
    (*s).light += light;
    (*s).albedo += albedo;
    (*s).light_light += light * light;
    (*s).light_albedo += light * albedo;
    (*s).albedo_albedo += albedo * albedo;
}

// Variance of demodulated illumination: the mean squared deviation of `count` samples from the ratio of the sums.
fn variance_of(s: Spread, count: f32) -> vec2<f32> {
    let ratio = ratio_of(s.light, s.albedo);
    let off = s.light_light - 2.0 * ratio * s.light_albedo + ratio * ratio * s.albedo_albedo;
    // Take the root first, so that the same threshold for black applies as for the mean.
    let deviation = ratio_of(sqrt(max(off, vec2<f32>(0.0)) / count), s.albedo / count);
    return deviation * deviation;
}

// Writes demodulated illumination and the pixel's counts. Illumination that is not finite is dropped.
fn leave_radiance(at: u32, reflected: vec3<f32>, gloss: vec3<f32>, albedo: Albedo, variance: vec2<f32>, counts: u32) {
    var matte_light = over(reflected, albedo.all);
    var gloss_light = vec3<f32>(0.0);
    if HAS_GLOSS {
        matte_light = over(reflected, albedo.matte);
        gloss_light = over(gloss, albedo.all - albedo.matte);
    }
    let ok = is_finite(matte_light) && is_finite(gloss_light);
    radiance_image[at] = select(vec4<u32>(0u, 0u, 0u, SAMPLED), pack_mean(matte_light, gloss_light, variance), ok);
    let clipped = select(0u, CLIPPED, ok && is_clipped(matte_light, gloss_light));
    tally_image[at] = add_tally(counts, 0u, select(1u, 0u, ok)) | clipped;
}

fn pack_mean(matte: vec3<f32>, gloss: vec3<f32>, variance: vec2<f32>) -> vec4<u32> {
    if MEASURES_VARIANCE && is_finite(variance.xyy) {
        return pack_sampled_with(matte, gloss, variance);
    }
    return pack_sampled(matte, gloss);
}

// Traces the samples of `pixel` of view `view` that this launch takes (`launched_samples`). Albedo, emission and radiance
// hold running means until the dispatch that ends at the last sample, which divides radiance by albedo.
fn sample_pixel(pixel: vec2<u32>, view: u32) {
    let at = pixel_index(pixel);
    let launched = launched_samples(pixel);
    let begin = launched.x;
    let end = launched.y;
    if VARIES_SAMPLES && begin == end {
        return;
    }
    let scale = 1.0 / f32(end);
    var tally = tally_image[at];
    let is_narrow = HAS_NARROW_LOBES && (hit_image[at].w & FLAG_VIEW_DEPENDENT) != 0u;
    var mixed = false;
    var albedo = vec3<f32>(0.0);
    var emission = vec3<f32>(0.0);
    // Specular light that no filter sees.
    var narrow = vec3<f32>(0.0);
    var reflected = vec3<f32>(0.0);
    var gloss = vec3<f32>(0.0);
    var matte = vec3<f32>(0.0);
    var spread = Spread();
    var i = begin;
    for (; i < end; i += 1u) {
        was_cut_short = false;
        var rng = rng_for(pixel, view, i);
        let direction = ray_of(view, vec2<f32>(pixel) + sample_offset(&rng));
        var rays = 0u;
        var hit: Hit;
        if JITTER || is_mirrored(hit_image[at]) {
            hit = primary_hit(view, direction, rng);
            rays = 1u;
        } else {
            hit = stored_hit(at);
        }
        var seen = first_surface(view, hit, direction, rng, rays);
        if JITTER {
            mixed = mixed || is_elsewhere(at, seen.first, seen.links.count);
            add_hard_light(&seen, rng);
        }
        rays = seen.rays;
        let start = start_of_path(seen, &rng, &rays);
        var first = seen.first;
        var path = PathSample();
        if (start.hit.hit.prim & SPHERE) == 0u {
            path = trace_path(start.hit.surface, start.direction, start.hit.medium, frame.sampling, start.links, recording_of(pixel, view, i), &rng);
        }
        var light = path.radiance * start.weight;
        var specular = path.gloss * start.weight;
        if start.is_reflection {
            light = (path.radiance + path.gloss) * start.weight + start.found;
            specular = select(vec3<f32>(0.0), light, is_split());
            light -= specular;
        }
        var unfiltered = vec3<f32>(0.0);
        if HAS_NARROW_LOBES {
            unfiltered = select(vec3<f32>(0.0), specular, is_narrow);
            // Without HAS_GLOSS, the filter takes both kinds of light as one.
            light += select(specular, vec3<f32>(0.0), is_narrow || HAS_GLOSS);
            specular = select(vec3<f32>(0.0), specular, HAS_GLOSS && !is_narrow);
        }
        light = scaled(light);
        specular = scaled(specular);
        // Sums of finite samples may be infinite.
        let with_radiance = reflected + light;
        let with_gloss = gloss + specular;
        let with_emission = emission + first.emission;
        let with_narrow = narrow + unfiltered;
        let ok = is_sound(&first) && is_finite(with_radiance) && is_finite(with_gloss) && is_finite(with_emission + with_narrow) && !was_cut_short;
        tally = add_tally(tally, rays + path.rays, select(1u, 0u, ok));
        if HAS_CACHE && ok && path.record.x != NO_CELL {
            let record = RECORD_WORDS * record_index(pixel);
            records[record] = path.record.x;
            records[record + 1u] = path.record.y;
            records[record + 2u] = path.record.z;
        }
        if ok {
            albedo += first.albedo;
            matte += first.matte;
            emission = with_emission;
            narrow = with_narrow;
            reflected = with_radiance;
            gloss = with_gloss;
            if MEASURES_VARIANCE {
                let reflects = select(first.albedo, first.matte, HAS_GLOSS);
                add_sample(&spread, two_luminances(light, specular), two_luminances(reflects, first.albedo - first.matte));
            }
        }
        // Without this, drivers keep a loop around the only sample.
        if !JITTER {
            i += 1u;
            break;
        }
    }
    // Count samples as dropped that never began because the driver ended the loop.
    tally = add_tally(tally, 0u, end - i);
    if !JITTER {
        if HAS_NARROW_LOBES {
            emission_image[at] += vec4<f32>(narrow, 0.0);
        }
        leave_radiance(at, reflected, gloss, Albedo(albedo, matte, 0.0), vec2<f32>(0.0), tally);
        return;
    }
    if mixed {
        hit_image[at].w |= FLAG_MIXED;
    }
    let keep = f32(begin) * scale;
    let old_albedo = unpack_albedo(albedo_image[at]);
    let old_emission = select(vec4<f32>(0.0), emission_image[at], begin > 0u);
    let old_radiance = unpack_sampled(select(vec4<u32>(0u), radiance_image[at], begin > 0u));
    let mean_albedo = Albedo(
        select(vec3<f32>(0.0), old_albedo.all, begin > 0u) * keep + albedo * scale,
        select(vec3<f32>(0.0), old_albedo.matte, begin > 0u) * keep + matte * scale,
        old_albedo.roughness,
    );
    let mean_reflected = old_radiance.matte * keep + reflected * scale;
    let mean_gloss = old_radiance.gloss * keep + gloss * scale;
    var variance = vec2<f32>(0.0);
    if MEASURES_VARIANCE {
        // Combine the variances of earlier and these samples, whose means differ as well (Chan, Golub & LeVeque 1983).
        let old_reflects = select(old_albedo.all, old_albedo.matte, HAS_GLOSS);
        let old = ratio_of(
            two_luminances(old_radiance.matte, old_radiance.gloss),
            two_luminances(old_reflects, old_albedo.all - old_albedo.matte),
        );
        let apart = select(vec2<f32>(0.0), old - ratio_of(spread.light, spread.albedo), begin > 0u);
        let of_these = variance_of(spread, f32(end - begin));
        variance = mix(of_these, old_radiance.a, keep) + apart * apart * keep * (1.0 - keep);
    }
    albedo_image[at] = pack_albedo(mean_albedo);
    emission_image[at] = vec4<f32>(old_emission.rgb * keep + (emission + narrow) * scale, emission_image[at].a);
    if end < samples_of(pixel) {
        radiance_image[at] = pack_mean(mean_reflected, mean_gloss, variance);
        tally_image[at] = tally | select(0u, CLIPPED, is_clipped(mean_reflected, mean_gloss));
        return;
    }
    leave_radiance(at, mean_reflected, mean_gloss, mean_albedo, variance, tally);
}
