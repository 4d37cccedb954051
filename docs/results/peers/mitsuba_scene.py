"""A shot that `diptych export` wrote, as a scene of Mitsuba 3.

The exported glTF is plain: one buffer, floats, 32-bit indices, PNG images, a node per instance with a matrix. So this
reads that and nothing else. What Mitsuba has no counterpart for is left out and named in `Shot.departures`.
"""

import json
import math
import struct
import tomllib
from pathlib import Path

import mitsuba as mi
import numpy as np

WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
TYPES = {5125: np.uint32, 5126: np.float32}
WRAPS = {10497: "repeat", 33648: "mirror", 33071: "clamp"}
NEAREST = 9728

# Mitsuba's GGX is not defined below.
LEAST_ROUGHNESS = 0.03

# The sun stands this many times the scene's size away, and the far plane behind it.
SUN_DISTANCE = 1e3


def linear_from_srgb(c):
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def rgb(values):
    return {"type": "rgb", "value": [float(v) for v in values]}


def normalized(v):
    return v / np.linalg.norm(v)


class Gltf:
    """The exported `.glb`."""

    def __init__(self, path):
        data = Path(path).read_bytes()
        (length,) = struct.unpack_from("<I", data, 12)
        self.json = json.loads(data[20 : 20 + length])
        self.bin = data[28 + length :]

    def entries(self, name):
        return self.json.get(name, [])

    def view(self, index):
        view = self.json["bufferViews"][index]
        return self.bin[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]

    def accessor(self, index):
        a = self.json["accessors"][index]
        return np.frombuffer(self.view(a["bufferView"]), TYPES[a["componentType"]]).reshape(-1, WIDTHS[a["type"]])

    def texels(self, index):
        """RGBA of an image, 0 to 1 as stored."""
        stream = mi.MemoryStream()
        data = self.view(self.json["images"][index]["bufferView"])
        stream.write(data)
        stream.seek(0)
        bitmap = mi.Bitmap(stream, mi.Bitmap.FileFormat.PNG)
        bitmap = bitmap.convert(mi.Bitmap.PixelFormat.RGBA, mi.Struct.Type.UInt8, srgb_gamma=True)
        return np.array(bitmap).astype(np.float32) / 255


class Materials:
    """glTF's materials as Mitsuba's BSDFs."""

    def __init__(self, gltf, departures):
        self.gltf, self.departures = gltf, departures

    def bitmap(self, info, change):
        """A texture of `change` of the RGBA texels that glTF's `info` refers to."""
        texture = self.gltf.entries("textures")[info["index"]]
        sampler = self.gltf.entries("samplers")[texture["sampler"]]
        texels = change(self.gltf.texels(texture["source"]))
        if sampler["wrapS"] != sampler["wrapT"]:
            self.departures.add("textures wrap in both directions as they do along u")
        if info.get("texCoord", 0) != 0:
            self.departures.add("textures on the second coordinate set take the first")
        turn = info.get("extensions", {}).get("KHR_texture_transform", {})
        (scale_u, scale_v), (du, dv) = turn.get("scale", (1, 1)), turn.get("offset", (0, 0))
        cos, sin = math.cos(turn.get("rotation", 0)), math.sin(turn.get("rotation", 0))
        uv_from_uv = [[scale_u * cos, scale_v * sin, du], [-scale_u * sin, scale_v * cos, dv], [0, 0, 1]]
        return {
            "type": "bitmap",
            "bitmap": mi.Bitmap(np.ascontiguousarray(texels, np.float32)),
            "raw": True,
            "filter_type": "nearest" if sampler["magFilter"] == NEAREST else "bilinear",
            "wrap_mode": WRAPS[sampler["wrapS"]],
            "to_uv": mi.ScalarTransform3f(uv_from_uv),
        }

    def bsdf(self, material):
        pbr, extensions = material["pbrMetallicRoughness"], material.get("extensions", {})
        factor = np.array(pbr["baseColorFactor"], np.float32)
        image = pbr.get("baseColorTexture")
        if image:
            color = self.bitmap(image, lambda texels: linear_from_srgb(texels[..., :3]) * factor[:3])
        else:
            color = rgb(factor[:3])
        inner = self.scattering(material, color)
        transmits = "spec_trans" in inner
        if "normalTexture" in material:
            normals = self.bitmap(material["normalTexture"], lambda texels: texels[..., :3])
            inner = {"type": "normalmap", "normalmap": normals, "bsdf": inner}
            if material["normalTexture"]["scale"] != 1:
                self.departures.add("scales of normal maps are left out")
        if not transmits:
            inner = {"type": "twosided", "bsdf": inner}
        mode = material.get("alphaMode", "OPAQUE")
        if mode == "OPAQUE":
            return inner

        def coverage(alpha):
            return (alpha >= material["alphaCutoff"]).astype(np.float32) if mode == "MASK" else alpha

        if image:
            opacity = self.bitmap(image, lambda texels: coverage(texels[..., 3:] * factor[3]))
        else:
            opacity = float(coverage(factor[3]))
        return {"type": "mask", "opacity": opacity, "bsdf": inner}

    def scattering(self, material, color):
        """Metal and dielectric together are Disney's `principled`, which is near glTF's model but not the same."""
        pbr, extensions = material["pbrMetallicRoughness"], material.get("extensions", {})
        specular = extensions.get("KHR_materials_specular", {"specularFactor": 1.0})
        metallic, roughness = pbr["metallicFactor"], pbr["roughnessFactor"]
        transmission = extensions.get("KHR_materials_transmission", {})
        if metallic == 0 and specular["specularFactor"] == 0 and not transmission:
            return {"type": "diffuse", "reflectance": color}
        self.departures.add("materials that shine are of the model `principled`, which is not glTF's")
        for extension in extensions:
            if extension in ("KHR_materials_clearcoat", "KHR_materials_volume", "KHR_materials_unlit"):
                self.departures.add(f"{extension} is left out")
        if "metallicRoughnessTexture" in pbr:
            image, metal, rough = pbr["metallicRoughnessTexture"], metallic, roughness
            metallic = self.bitmap(image, lambda texels: texels[..., 2:3] * metal)
            roughness = self.bitmap(image, lambda texels: np.maximum(texels[..., 1:2] * rough, LEAST_ROUGHNESS))
        else:
            roughness = max(roughness, LEAST_ROUGHNESS)
        principled = {"type": "principled", "base_color": color, "metallic": metallic, "roughness": roughness}
        if transmission:
            ior = extensions.get("KHR_materials_ior", {}).get("ior", 1.5)
            return principled | {"spec_trans": transmission["transmissionFactor"], "eta": max(ior, 1.001)}
        return principled | {"specular": 0.5 * specular["specularFactor"]}

    def emitter(self, material):
        """None where nothing is emitted."""
        strength = material.get("extensions", {}).get("KHR_materials_emissive_strength", {}).get("emissiveStrength", 1)
        radiance = np.array(material.get("emissiveFactor", [0, 0, 0]), np.float32) * strength
        if not radiance.any():
            return None
        if material.get("doubleSided"):
            self.departures.add("double-sided surfaces emit to their front")
        emitted = rgb(radiance)
        if "emissiveTexture" in material:
            image = material["emissiveTexture"]
            emitted = self.bitmap(image, lambda texels: linear_from_srgb(texels[..., :3]) * radiance)
        return {"type": "area", "radiance": emitted}


class Shot:
    """`toml` is what `diptych export` wrote; meshes go through files in `scratch`."""

    def __init__(self, toml, scratch):
        toml = Path(toml)
        self.shot = tomllib.loads(toml.read_text())
        self.name = self.shot["name"]
        self.departures = set()
        self.gltf = Gltf(toml.parent / self.shot["scene"])
        self.materials = self.gltf.entries("materials")
        # Mitsuba's plain path tracer takes masks for opaque where it looks for light.
        self.has_alpha = any(m.get("alphaMode", "OPAQUE") != "OPAQUE" for m in self.materials)
        self.scene = self.shapes(Path(scratch))
        self.scene |= self.lights() | self.environment(toml.parent)

    def shapes(self, scratch):
        """Everything that is of one material is one mesh in the world, the fastest that Mitsuba can have it."""
        parts = [[] for _ in self.materials]
        for node in self.gltf.entries("nodes"):
            world = np.array(node.get("matrix", np.eye(4).ravel())).reshape(4, 4).T
            for primitive in self.gltf.json["meshes"][node["mesh"]]["primitives"]:
                parts[primitive["material"]].append((world, primitive))
        materials = Materials(self.gltf, self.departures)
        shapes, low, high = {}, [], []
        for index, (material, members) in enumerate(zip(self.materials, parts)):
            if not members:
                continue
            positions, normals, uvs, faces = merge(self.gltf, members, self.departures)
            low.append(positions.min(0))
            high.append(positions.max(0))
            path = scratch / f"{index}.ply"
            write_ply(path, positions, normals, uvs, faces)
            shape = {"type": "ply", "filename": str(path), "bsdf": materials.bsdf(material)}
            emitter = materials.emitter(material)
            shapes[f"shape{index}"] = shape | ({"emitter": emitter} if emitter else {})
        self.low, self.high = np.min(low, 0), np.max(high, 0)
        self.size = float(np.linalg.norm(self.high - self.low))
        return shapes

    def lights(self):
        lights = {}
        for index, light in enumerate(self.shot.get("light", [])):
            lights[f"light{index}"] = self.light(light)
        return lights

    def light(self, light):
        strength = np.array(light["color"])
        radius = light.get("radius_m", 0) / self.shot["rig"]["metres_per_unit"]
        if light["kind"] == "directional":
            direction, angle = normalized(np.array(light["direction"])), math.radians(light["angle_deg"])
            if angle == 0:
                return {"type": "directional", "direction": list(direction), "irradiance": rgb(strength)}
            # A disc of the sun's size in the sky, so far away that it is at the same place from everywhere.
            centre, distance = (self.low + self.high) / 2, SUN_DISTANCE * self.size
            place = mi.ScalarTransform4f().look_at(
                origin=list(centre - direction * distance), target=list(centre), up=upright(direction)
            ) @ mi.ScalarTransform4f().scale(distance * math.tan(angle))
            radiance = rgb(strength / (math.pi * math.sin(angle) ** 2))
            return {"type": "disk", "to_world": place, "emitter": {"type": "area", "radiance": radiance}}
        position = light["position"]
        if light["kind"] == "spot":
            self.departures.add("spots are points that fade as Mitsuba's do")
            target = list(np.array(position) + np.array(light["direction"]))
            place = mi.ScalarTransform4f().look_at(origin=position, target=target, up=upright(light["direction"]))
            cones = {"cutoff_angle": light["outer_cone_deg"], "beam_width": light["inner_cone_deg"]}
            return {"type": "spot", "to_world": place, "intensity": rgb(strength)} | cones
        if radius == 0:
            return {"type": "point", "position": position, "intensity": rgb(strength)}
        radiance = rgb(strength / (math.pi * radius**2))
        emitter = {"type": "area", "radiance": radiance}
        return {"type": "sphere", "center": position, "radius": radius, "emitter": emitter}

    def environment(self, folder):
        environment = self.shot.get("environment", {})
        if "radiance" in environment:
            return {"environment": {"type": "constant", "radiance": rgb(environment["radiance"])}}
        if "image" in environment:
            # The middle of diptych's image is at -z, the edge of Mitsuba's.
            place = mi.ScalarTransform4f().rotate([0, 1, 0], 180 + environment["rotation_deg"])
            image = str(folder / environment["image"])
            return {"environment": {"type": "envmap", "filename": image, "to_world": place}}
        return {}

    def cameras(self, time_s, width, height):
        """Left and right eye at an instant of the path."""
        rig = self.shot["rig"]
        film = {
            "type": "hdrfilm", "width": width, "height": height, "pixel_format": "rgb", "component_format": "float32",
            "rfilter": {"type": "box"},
        }
        cameras = {}
        for eye, (position, target, up) in zip(("left", "right"), self.eyes(time_s)):
            place = mi.ScalarTransform4f().look_at(origin=list(position), target=list(target), up=list(up))
            cameras[eye] = {
                "type": "perspective", "fov": rig["yfov_deg"], "fov_axis": "y", "to_world": place, "film": film,
                "near_clip": 1e-4 * self.size, "far_clip": 10 * SUN_DISTANCE * self.size,
            }
        return cameras

    def eyes(self, time_s):
        """Position, target and up of the left and the right eye."""
        rig, (position, target, up) = self.shot["rig"], self.pose(time_s)
        right = normalized(np.cross(normalized(target - position), up))
        half = 0.5 * rig["baseline_m"] / rig["metres_per_unit"] * right
        return [(position + side * half, target + side * half, up) for side in (-1, 1)]

    def pose(self, time_s):
        """Position, target and up: keys are interpolated linearly, and held before the first and after the last."""
        keys = self.shot["rig"]["key"]
        times = [key["time_s"] for key in keys]

        def at(name):
            return np.array([np.interp(time_s, times, [key[name][c] for key in keys]) for c in range(3)])

        return at("position"), at("target"), at("up")

    def integrator(self, bounces):
        """Without Russian roulette, as diptych has none."""
        return {"type": "volpath" if self.has_alpha else "path", "max_depth": bounces + 1, "rr_depth": 1 << 20}

    def load(self, time_s, width, height, bounces):
        """The scene, whose sensors are the left and the right eye."""
        cameras = self.cameras(time_s, width, height)
        return mi.load_dict({"type": "scene", "integrator": self.integrator(bounces)} | self.scene | cameras)


def upright(direction):
    """Any direction that is not parallel to it."""
    return [1, 0, 0] if abs(direction[1]) > 0.9 else [0, 1, 0]


def merge(gltf, members, departures):
    """World-space positions, normals, coordinates and faces of primitives; normals where all have them."""
    positions, normals, uvs, faces, count = [], [], [], [], 0
    for world, primitive in members:
        attributes = primitive["attributes"]
        if "COLOR_0" in attributes:
            departures.add("vertex colours are left out")
        local = gltf.accessor(attributes["POSITION"]).astype(np.float64)
        linear = world[:3, :3]
        positions.append(local @ linear.T + world[:3, 3])
        if "NORMAL" in attributes:
            turned = gltf.accessor(attributes["NORMAL"]).astype(np.float64) @ np.linalg.inv(linear)
            normals.append(turned / np.maximum(np.linalg.norm(turned, axis=1, keepdims=True), 1e-30))
        uvs.append(gltf.accessor(attributes["TEXCOORD_0"]) if "TEXCOORD_0" in attributes else np.zeros((len(local), 2)))
        triangles = gltf.accessor(primitive["indices"]).reshape(-1, 3).astype(np.int64)
        mirrored = np.linalg.det(linear) < 0
        faces.append((triangles[:, ::-1] if mirrored else triangles) + count)
        count += len(local)
    if 0 < len(normals) < len(members):
        departures.add("meshes of one material are flat where some of them are")
    normals = np.vstack(normals) if len(normals) == len(members) else None
    return np.vstack(positions), normals, np.vstack(uvs), np.vstack(faces)


def write_ply(path, positions, normals, uvs, faces):
    columns = {"xyz": positions, "uv": uvs} if normals is None else {"xyz": positions, "n": normals, "uv": uvs}
    names = [name for key in columns for name in {"n": ["nx", "ny", "nz"]}.get(key, key)]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(positions)}"]
    header += [f"property float {name}" for name in names]
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
    rows = np.empty(len(faces), [("count", "u1"), ("corners", "<i4", 3)])
    rows["count"], rows["corners"] = 3, faces
    vertices = np.hstack(list(columns.values())).astype("<f4")
    path.write_bytes("\n".join(header).encode() + vertices.tobytes() + rows.tobytes())
