//!include frame math tables scene trace

// Returns the nearest hit up to `t_max` that passes its alpha test (the lowest triangle number among equal distances),
// or any such hit if `any`. `any` is always a literal, so that each kind of call is specialised. `key` identifies the
// ray for `is_covered`.
//
// Traversal pauses at triangles that need an alpha test, and the rays of a subgroup then test together. Software
// drivers mask branches instead of skipping them, so that a test inside the traversal loop would be paid for at every
// triangle.
fn traverse(origin: vec3<f32>, direction: vec3<f32>, t_max: f32, key: u32, any: bool) -> Hit {
    var hit = Hit(t_max, NO_PRIM, vec2<f32>(0.0));
    // Hit whose alpha test is pending. It replaces `hit` if it passes the test.
    var candidate = hit;
    var candidate_row = 0u;
    let world = traversal_for(origin, direction, frame_around(direction));
    var ray = world;
    var top = 0u;
    var group = vec2<u32>(0u, 0x80000000u);
    var leaf = vec2<u32>(0u);
    var is_done = false;
    // State of the current instance. The ray begins in the first one, which is not transformed.
    var is_inside = true;
    var row_offset = 0u;
    // Stack entries below this belong to the tree over instances.
    var base = 0u;
    // Leaf group of the tree over instances: the instances that the ray has yet to enter.
    var entries = vec2<u32>(0u);
    if HAS_INSTANCES && frame.geometry.instance_count > 1u {
        stack[0] = vec2<u32>(frame.geometry.instance_tree, 0x80000000u);
        top = 1u;
        base = 1u;
    }
    loop {
        while !is_done && (!HAS_ALPHA || candidate.prim == NO_PRIM) {
            if HAS_ALPHA && leaf.y != 0u {
                // Resume with the rest of the triangles where traversal paused.
            } else if group.y > 0x00ffffffu {
                let bit = firstLeadingBit(group.y);
                let slot = (bit - 24u) ^ (ray.octant & 7u);
                let child = group.x + countOneBits(group.y & ~(0xffffffffu << slot) & 0xffu);
                group.y &= ~(1u << bit);
                // Stored unconditionally, since uniform work costs software drivers less.
                stack[min(top, STACK_SIZE - 1u)] = group;
                top += select(0u, 1u, group.y > 0x00ffffffu && top < STACK_SIZE);
                let n0 = node_part(child, 0u);
                let n1 = node_part(child, 1u);
                let mask = hit_children(ray, n0, n1.zw, child, hit.t);
                group = vec2<u32>(n1.x, (mask & 0xff000000u) | (n0.w >> 24u));
                leaf = vec2<u32>(n1.y, mask & 0x00ffffffu);
            } else {
                leaf = group;
                group = vec2<u32>(0u);
            }
            if HAS_INSTANCES && !is_inside {
                entries = leaf;
                leaf.y = 0u;
                if entries.y != 0u && group.y > 0x00ffffffu && top < STACK_SIZE {
                    stack[top] = group;
                    top += 1u;
                    group.y = 0u;
                }
            }
            while leaf.y != 0u {
                let row = leaf.x + firstTrailingBit(leaf.y);
                leaf.y &= leaf.y - 1u;
                let found = intersect_triangle(ray, row, hit.t);
                let first_copy = stored_triangle(row).first_copy;
                let prim = (first_copy & ~TRIANGLE_ALPHA) - row_offset;
                let is_first = found.x > 0.0 && (found.x < hit.t || prim < hit.prim);
                if is_first {
                    let nearer = Hit(found.x, prim, found.yz);
                    if HAS_ALPHA && (first_copy & TRIANGLE_ALPHA) != 0u {
                        candidate = nearer;
                        candidate_row = row;
                        break;
                    }
                    hit = nearer;
                    if any {
                        is_done = true;
                        break;
                    }
                }
            }
            if HAS_INSTANCES {
                // Whether the ray leaves an instance, or leaves the tree over instances to enter one.
                let is_through = select(entries.y != 0u, top == base, is_inside);
                var is_over = group.y <= 0x00ffffffu && leaf.y == 0u && is_through && !is_done;
                // A loop in place of a branch: it runs at most once, and software drivers skip loops but not branches.
                while is_over {
                    is_over = false;
                    is_inside = entries.y != 0u;
                    if is_inside {
                        let number = entries.x + firstTrailingBit(entries.y);
                        let instance = frame.geometry.instances + ROWS_PER_INSTANCE * number;
                        entries.y &= entries.y - 1u;
                        let header = instance_header(instance);
                        row_offset = header.y;
                        group = vec2<u32>(header.z, 0x80000000u);
                        base = top;
                        ray = local_traversal(instance, origin, direction);
                    } else {
                        base = 0u;
                        ray = world;
                    }
                }
            }
            if group.y <= 0x00ffffffu && leaf.y == 0u {
                is_done = is_done || top == 0u;
                top = max(top, 1u) - 1u;
                group = stack[top];
            }
        }
        if !HAS_ALPHA || candidate.prim == NO_PRIM {
            break;
        }
        if is_covered(candidate_row, candidate.prim, candidate.bary, key) {
            hit = candidate;
            is_done = is_done || any;
        }
        candidate.prim = NO_PRIM;
    }
    was_cut_short = was_cut_short || !is_done;
    return hit;
}
