#!/usr/bin/env python3
"""Renders the stored scene truths with Mitsuba 3 (`pip install mitsuba`, and LLVM's library).

    truth.py NAME SCENE.toml OUT.exr --size 320x180 --time 1 --spp 4096 [--without-objects]

SCENE is a scene file with its `[room]`, as `iprt scene export` writes it. OUT gets two layers, `a` and `b`: two independent
pictures of linear radiance with `--spp` samples a pixel each, as half-floats of 8 significant bits. Their noise is larger
than what the rounding takes. `index.json` beside OUT gets a line about it, with NAME for the scene. Sums are kept in
target/truth, so a second run with more samples goes on where the first ended. `scripts/truths` renders all of them.

Everything but the material is Mitsuba's: geometry, visibility, lamps, light sampling, Russian roulette, film. The material is
glTF's, written anew from the specification; what glTF leaves open is done as docs/pipeline.md says. Lamps shine from both
sides, as everywhere in iprt.
"""

import argparse
import json
import tempfile
import tomllib
from pathlib import Path

import mitsuba as mi
import numpy as np

from render import Glb, camera, directional_albedo, rgb, write_ply

import drjit as dr  # noqa: E402 (needs the variant, which render sets)

HERE = Path(__file__).parent
PASS = 64  # samples a pixel of one call of Mitsuba, spread over the pixel and all that they draw
COSINES = 128


class World:
    """All triangles of a scene, by what they send out, and their materials as arrays."""

    def __init__(self, scene, time, without_objects):
        folder = scene.parent
        self.file = tomllib.loads(scene.read_text())
        self.materials, self.texels, self.groups = [], [np.zeros((1, 3), np.float32)], {}
        self.roughness = []
        self.add(folder / self.file["room"]["gltf"], np.eye(4), time)
        for thing in [] if without_objects else self.file["object"]:
            assert set(thing) <= {"name", "gltf", "translation", "rotation", "scale", "key"}, f"{scene}: {thing['name']}"
            self.add(folder / thing["gltf"], matrix({**thing, **at_time(thing.get("key", []), time)}), time)

    def add(self, path, place, time):
        glb = Glb(path)
        first = len(self.materials)
        self.materials += [self.material(glb, m) for m in glb.json["materials"]]
        moved = {}
        for clip in glb.json.get("animations", [])[:1]:
            for channel in clip["channels"]:
                sampler = clip["samplers"][channel["sampler"]]
                assert sampler["interpolation"] == "STEP", f"{path}: only steps are read"
                times = glb.array(sampler["input"])[:, 0]
                value = glb.array(sampler["output"])[np.searchsorted(times, time % times[-1], side="right") - 1]
                moved.setdefault(channel["target"]["node"], {})[channel["target"]["path"]] = value
        nodes = glb.json["nodes"]
        parents = {child: i for i, node in enumerate(nodes) for child in node.get("children", [])}

        def to_world(i):
            own = matrix({**nodes[i], **moved.get(i, {})})
            return (to_world(parents[i]) if i in parents else place) @ own

        for i, node in enumerate(nodes):
            for part in glb.json["meshes"][node["mesh"]]["primitives"] if "mesh" in node else []:
                at = part["attributes"]
                m = to_world(i)
                positions = glb.array(at["POSITION"]) @ m[:3, :3].T + m[:3, 3]
                normals = glb.array(at["NORMAL"]) @ np.linalg.inv(m[:3, :3])
                normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-20)
                uvs = glb.array(at["TEXCOORD_0"]) if "TEXCOORD_0" in at else np.zeros((len(positions), 2))
                faces = glb.array(part["indices"]).reshape(-1, 3)
                material = first + part["material"]
                group = self.groups.setdefault(self.materials[material]["emissive"], [])
                group.append((np.hstack([positions, normals, uvs]), faces, np.full(len(faces), material)))

    def material(self, glb, m):
        known = {"KHR_materials_specular", "KHR_materials_emissive_strength"}
        extensions = m.get("extensions", {})
        pbr = m["pbrMetallicRoughness"]
        unread = set(extensions) - known | set(m) & {"normalTexture", "emissiveTexture"} | set(pbr) & {"metallicRoughnessTexture"}
        assert not unread, f"{m['name']}: {unread} is not read"
        strength = extensions.get("KHR_materials_emissive_strength", {}).get("emissiveStrength", 1)
        metallic, roughness = pbr.get("metallicFactor", 1), pbr.get("roughnessFactor", 1)
        specular = extensions.get("KHR_materials_specular", {}).get("specularFactor", 1)
        if roughness not in self.roughness:
            self.roughness.append(roughness)
        out = {
            "base_color": pbr.get("baseColorFactor", [1, 1, 1])[:3],
            "metallic": metallic,
            "alpha": roughness**2,
            "specular": specular,
            "energy": self.roughness.index(roughness),
            "emissive": tuple(strength * e for e in m.get("emissiveFactor", [0, 0, 0])),
            "texture": [0, 1, 1, 0],
        }
        if "baseColorTexture" in pbr:
            texture = glb.json["textures"][pbr["baseColorTexture"]["index"]]
            stream = mi.MemoryStream()
            stream.write(glb.view(glb.json["images"][texture["source"]]["bufferView"]))
            stream.seek(0)
            codes = np.array(mi.Bitmap(stream))[..., :3] / 255
            linear = np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4).astype(np.float32)
            style = glb.json["samplers"][texture["sampler"]]
            nearest, clamped = style["magFilter"] == 9728, style.get("wrapS", 10497) == 33071
            assert clamped or style.get("wrapS", 10497) == 10497, f"{m['name']}: mirrored textures are not read"
            out["texture"] = [sum(map(len, self.texels)), codes.shape[1], codes.shape[0], nearest + 2 * clamped]
            self.texels.append(linear.reshape(-1, 3))
        return out

    def scene(self, size):
        view = self.file["camera"]
        assert "key" not in view, "the camera stands still"
        sensor = camera(view["position"], view["look_at"], view["fov_y"], size) | {"sampler": {"type": "multijitter"}}
        world = {"type": "scene", "sensor": sensor}
        with tempfile.TemporaryDirectory() as folder:
            for i, (emissive, parts) in enumerate(self.groups.items()):
                starts = np.cumsum([0] + [len(vertices) for vertices, _, _ in parts])
                faces = np.vstack([faces + start for (_, faces, _), start in zip(parts, starts)])
                path = Path(folder) / f"{i}.ply"
                write_ply(path, np.vstack([vertices for vertices, _, _ in parts]), faces)
                surfaces = Surfaces.of(self, np.concatenate([material for _, _, material in parts]))
                world[f"part{i}"] = {"type": "ply", "filename": str(path), "bsdf": surfaces}
                if any(emissive):
                    corners = np.vstack([vertices[faces, :3] for vertices, faces, _ in parts])
                    edges = corners[:, 1:] - corners[:, :1]
                    power = max(emissive) * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1).sum()
                    lamp = {"type": "two_sided", "radiance": rgb(emissive), "sampling_weight": float(power)}
                    world[f"part{i}"]["emitter"] = lamp
            return mi.load_dict(world)


def matrix(placed):
    m = np.eye(4)
    x, y, z, w = (float(v) for v in placed.get("rotation", [0, 0, 0, 1]))
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    m[:3, :3] = np.array(rows) * np.array(placed.get("scale", [1, 1, 1]))
    m[:3, 3] = placed.get("translation", [0, 0, 0])
    return m


def at_time(keys, time):
    """The values of key frames at a time: spherically linear for rotations, linear for the others."""
    out = {}
    for name in {name for key in keys for name in key} - {"time"}:
        own = [key for key in keys if name in key]
        times = [key["time"] for key in own]
        i = int(np.clip(np.searchsorted(times, time, side="right") - 1, 0, len(own) - 2))
        t = np.clip((time - times[i]) / (times[i + 1] - times[i]), 0, 1)
        a, b = np.array(own[i][name]), np.array(own[i + 1][name])
        share = [1 - t, t]
        if name == "rotation":
            a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
            b = b if a @ b >= 0 else -b
            angle = np.arccos(min(a @ b, 1.0))
            if angle > 1e-6:
                share = [np.sin((1 - t) * angle) / np.sin(angle), np.sin(t * angle) / np.sin(angle)]
        out[name] = share[0] * a + share[1] * b
    return out


class Surfaces(mi.BSDF):
    """glTF 2.0 metallic-roughness on all triangles of a mesh, each with its own material; a mirror where roughness is 0."""

    @classmethod
    def of(cls, world, face_materials):
        surfaces = mi.load_dict({"type": "surfaces"})
        column = lambda name: mi.Float(np.array([m[name] for m in world.materials], np.float32))  # noqa: E731
        surfaces.face_material = mi.UInt32(face_materials.astype(np.uint32))
        surfaces.base_color = mi.Float(np.array([m["base_color"] for m in world.materials], np.float32).ravel())
        surfaces.metallic, surfaces.specular, surfaces.alpha = column("metallic"), column("specular"), column("alpha")
        surfaces.energy = mi.UInt32(np.array([m["energy"] for m in world.materials], np.uint32))
        surfaces.texture = mi.UInt32(np.array([m["texture"] for m in world.materials], np.uint32).ravel())
        surfaces.texels = mi.Float(np.concatenate(world.texels).ravel())
        tables = [directional_albedo(r * r, COSINES, (512, 128)) for r in world.roughness]
        surfaces.table = mi.Float(np.array(tables, np.float32).ravel())
        return surfaces

    def __init__(self, props):
        mi.BSDF.__init__(self, props)
        flags = mi.BSDFFlags
        kinds = flags.DiffuseReflection | flags.GlossyReflection | flags.DeltaReflection
        self.m_components = [kinds | flags.FrontSide | flags.BackSide]
        self.m_flags = self.m_components[0]

    def texel(self, start, width, height, clamped, x, y):
        # x and y are whole numbers, at most one texel outside where a texture repeats
        wrap = lambda v, size: dr.select(clamped, dr.clip(v, 0, size - 1), v - dr.floor(v / size) * size)  # noqa: E731
        column, row = mi.UInt32(wrap(x, width)), mi.UInt32(wrap(y, height))
        return dr.gather(mi.Color3f, self.texels, start + row * mi.UInt32(width) + column)

    def textured(self, si, material):
        of = lambda k: dr.gather(mi.UInt32, self.texture, 4 * material + k)  # noqa: E731
        start, width, height, style = of(0), mi.Float(of(1)), mi.Float(of(2)), of(3)
        clamped = style >= 2
        fraction = lambda v: dr.select(clamped, v, v - dr.floor(v))  # noqa: E731
        x, y = fraction(si.uv.x) * width - 0.5, fraction(si.uv.y) * height - 0.5
        nearest = (style & 1) == 1
        x, y = dr.select(nearest, dr.floor(x + 0.5), x), dr.select(nearest, dr.floor(y + 0.5), y)
        left, top = dr.floor(x), dr.floor(y)
        at = lambda dx, dy: self.texel(start, width, height, clamped, left + dx, top + dy)  # noqa: E731
        row = lambda dy: dr.lerp(at(0, dy), at(1, dy), x - left)  # noqa: E731
        color = dr.lerp(row(0), row(1), y - top)
        return dr.select(start > 0, color, 1.0)

    def surface(self, si):
        """Material and frame. Both normals face the ray. A shading normal that faces away is tilted to the horizon."""
        s = type("Surface", (), {})()
        material = dr.gather(mi.UInt32, self.face_material, si.prim_index)
        metallic = dr.gather(mi.Float, self.metallic, material)
        specular = dr.gather(mi.Float, self.specular, material)
        base = dr.gather(mi.Color3f, self.base_color, material) * self.textured(si, material)
        s.alpha = dr.gather(mi.Float, self.alpha, material)
        s.mirror = s.alpha < 1e-3
        s.f0 = dr.lerp(mi.Color3f(0.04 * specular), base, metallic)
        s.f90 = dr.lerp(specular, 1.0, metallic)
        to_eye = si.to_world(si.wi)
        turned = dr.dot(si.n, to_eye) < 0
        s.geometric = dr.select(turned, -si.n, si.n)
        normal = mi.Vector3f(dr.select(turned, -si.sh_frame.n, si.sh_frame.n))
        facing = dr.dot(normal, to_eye)
        normal = dr.select(facing < 1e-3, dr.normalize(normal + to_eye * (1e-3 - facing)), normal)
        s.frame = mi.Frame3f(normal)
        s.eye = s.frame.to_local(to_eye)
        # the parts of F0 and F90 in the directional albedo, linear between the table's entries
        at = dr.clip(s.eye.z * COSINES - 1, 0, COSINES - 1.001)
        low = mi.UInt32(at)
        first = 2 * (dr.gather(mi.UInt32, self.energy, material) * COSINES + low)
        part = lambda k: dr.lerp(dr.gather(mi.Float, self.table, first + k), dr.gather(mi.Float, self.table, first + k + 2), at - mi.Float(low))  # noqa: E731
        x, y = part(0), part(1)
        s.scale = 1 + s.f0 * (1 / dr.maximum(x + y, 1e-3) - 1)
        albedo = dr.minimum((s.f0 * x + s.f90 * y) * s.scale, 1)
        s.lambert = base * (1 - metallic) * (1 - dr.max(albedo))
        ws, wd = mi.luminance(albedo), mi.luminance(s.lambert)
        s.share = dr.select(ws <= 0, 0, dr.select(wd <= 0, 1, dr.clip(ws / (ws + wd), 0.1, 0.9)))
        return s

    def value(self, s, wo):
        """BRDF times cosine, and the density of drawing it. Directions are in the frame of `surface`."""
        ok = (wo.z > 0) & (dr.dot(s.frame.to_world(wo), s.geometric) > 0)
        nv, nl = dr.maximum(s.eye.z, 1e-4), dr.maximum(wo.z, 1e-6)
        h = dr.normalize(s.eye + wo)
        a2 = dr.maximum(s.alpha, 1e-3) ** 2
        d = a2 / (dr.pi * (h.z * h.z * a2 + h.x * h.x + h.y * h.y) ** 2)
        v = 0.5 / (nl * dr.sqrt(nv * nv * (1 - a2) + a2) + nv * dr.sqrt(nl * nl * (1 - a2) + a2))
        fresnel = s.f0 + (s.f90 - s.f0) * dr.maximum(1 - dr.dot(s.eye, h), 0) ** 5
        rough = dr.select(s.mirror, mi.Color3f(0), fresnel * s.scale * (d * v))
        lobe = mi.MicrofacetDistribution(mi.MicrofacetType.GGX, dr.maximum(s.alpha, 1e-3)).pdf(s.eye, h) / (4 * dr.dot(wo, h))
        density = s.share * dr.select(s.mirror, 0, lobe) + (1 - s.share) * nl / dr.pi
        return (s.lambert / dr.pi + rough) * nl & ok, dr.select(ok, density, 0)

    def sample(self, context, si, sample1, sample2, active):
        s = self.surface(si)
        shiny = sample1 < s.share
        m, _ = mi.MicrofacetDistribution(mi.MicrofacetType.GGX, dr.maximum(s.alpha, 1e-3)).sample(s.eye, sample2)
        m = dr.select(s.mirror, mi.Normal3f(0, 0, 1), m)
        wo = dr.select(shiny, mi.reflect(s.eye, m), mi.warp.square_to_cosine_hemisphere(sample2))
        mirrored = shiny & s.mirror
        value, density = self.value(s, wo)
        ok = active & (wo.z > 0) & (dr.dot(s.frame.to_world(wo), s.geometric) > 0)
        fresnel = s.f0 + (s.f90 - s.f0) * (1 - s.eye.z) ** 5
        bs = dr.zeros(mi.BSDFSample3f)
        bs.eta = 1.0
        bs.sampled_component = 0
        bs.wo = si.to_local(s.frame.to_world(wo))
        bs.pdf = dr.select(mirrored, s.share, density) & ok
        flags = mi.BSDFFlags
        bs.sampled_type = dr.select(mirrored, mi.UInt32(flags.DeltaReflection.value), mi.UInt32(flags.GlossyReflection.value))
        weight = dr.select(mirrored, fresnel * s.scale / s.share, value / density)
        return bs, weight & (ok & (bs.pdf > 0))

    def eval_pdf(self, context, si, wo, active):
        s = self.surface(si)
        value, density = self.value(s, s.frame.to_local(si.to_world(wo)))
        return value & active, dr.select(active, density, 0)

    def eval(self, context, si, wo, active):
        return self.eval_pdf(context, si, wo, active)[0]

    def pdf(self, context, si, wo, active):
        return self.eval_pdf(context, si, wo, active)[1]

    def to_string(self):
        return "Surfaces[]"


class TwoSided(mi.Emitter):
    """A surface that sends the same radiance everywhere, from both sides."""

    def __init__(self, props):
        mi.Emitter.__init__(self, props)
        self.radiance = mi.Color3f(props["radiance"])
        self.m_flags = mi.EmitterFlags.Surface.value

    def eval(self, si, active):
        return self.radiance & active

    def sample_direction(self, it, sample, active):
        ds = self.get_shape().sample_direction(it, sample, active)
        active &= ds.pdf > 0
        ds.emitter = mi.EmitterPtr(self)
        return ds, (self.radiance / ds.pdf) & active

    def pdf_direction(self, it, ds, active):
        return self.get_shape().pdf_direction(it, ds, active)

    def eval_direction(self, it, ds, active):
        return self.radiance & active

    def to_string(self):
        return "TwoSided[]"


mi.register_bsdf("surfaces", Surfaces)
mi.register_emitter("two_sided", TwoSided)


def rounded(values):
    """Values with 8 significant bits."""
    share, power = np.frexp(values)
    return np.ldexp(np.round(share * 256) / 256, power).astype(np.float16)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("name")
    parser.add_argument("scene", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--size", default="320x180")
    parser.add_argument("--time", type=float, default=0.0, help="seconds")
    parser.add_argument("--spp", type=int, default=4096, help="samples a pixel of each half")
    parser.add_argument("--without-objects", action="store_true")
    args = parser.parse_args()
    width, height = (int(side) for side in args.size.split("x"))
    state = HERE.parents[1] / "target/truth" / f"{args.out.stem}.npz"
    state.parent.mkdir(parents=True, exist_ok=True)
    sums, passes = np.zeros((2, height, width, 3)), 0
    if state.exists():
        kept = np.load(state)
        sums, passes = kept["sums"], int(kept["passes"])
    if passes * PASS < args.spp:
        scene = World(args.scene, args.time, args.without_objects).scene((width, height))
    integrator = mi.load_dict({"type": "path", "max_depth": -1, "rr_depth": 5})
    while passes * PASS < args.spp:
        for half in range(2):
            sums[half] += np.array(mi.render(scene, integrator=integrator, spp=PASS, seed=2 * passes + half))
        passes += 1
        np.savez(state.with_suffix(".new.npz"), sums=sums, passes=passes)
        state.with_suffix(".new.npz").replace(state)
    halves = rounded(sums / passes)
    names = [f"{half}.{channel}" for half in "ab" for channel in "RGB"]
    bitmap = mi.Bitmap(np.concatenate(halves, axis=2), pixel_format=mi.Bitmap.PixelFormat.MultiChannel, channel_names=names)
    bitmap.write(str(args.out))
    index = args.out.parent / "index.json"
    entry = {"file": args.out.name, "scene": args.name, "objects": not args.without_objects, "time": args.time}
    entry |= {"size": [width, height], "made_by": f"Mitsuba {mi.__version__}", "samples": 2 * passes * PASS}
    others = [e for e in json.loads(index.read_text()) if e["file"] != args.out.name] if index.exists() else []
    index.write_text(json.dumps(sorted([*others, entry], key=lambda e: e["file"]), indent=2) + "\n")
    print(f"{args.out}: {entry['made_by']}, {entry['samples']} samples a pixel")


if __name__ == "__main__":
    main()
