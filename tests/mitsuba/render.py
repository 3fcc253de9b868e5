"""Pictures by Mitsuba 3, an independent renderer, that scene truth is compared with (tests/headless/mitsuba.rs).

    python -m venv V && V/bin/pip install mitsuba numpy
    V/bin/python tests/mitsuba/render.py balls
    MITSUBA_VARIANT=scalar_rgb V/bin/python tests/mitsuba/render.py spheres --spp 8192
    V/bin/python tests/mitsuba/render.py room DATA/rooms/room     # of the folder that IPRT_DATA names

Each writes tests/mitsuba/NAME_values.json: a small picture, box-filtered, so that every pixel is the mean of a patch of
the view, and the standard error of each value, from runs of other seeds. LLVM 19 was used, named by DRJIT_LIBLLVM_PATH; Debian 12's
14 and 15 abort. The spheres need no LLVM: their materials are Mitsuba's own plugins, none written here.

The material of the other scenes is written here from glTF 2.0, appendix B, not from this project's shaders. What glTF leaves open
is done as docs/pipeline.md says: GGX scaled by 1 + F0 (1/E - 1) (Turquin 2019), Lambert scaled by 1 - max(rho). Mitsuba's own code
does the rest: geometry, visibility, lamps, light and lobe sampling, visible normals, Russian roulette.
"""

import argparse
import json
import math
import os
import struct
import tempfile
from pathlib import Path

import mitsuba as mi
import numpy as np

mi.set_variant(os.environ.get("MITSUBA_VARIANT", "llvm_ad_rgb"))
import drjit as dr  # noqa: E402 (needs the variant)

HERE = Path(__file__).parent
SIZES = {"balls": (8, 6), "spheres": (12, 8), "room": (8, 6)}
COSINES = 512  # of the tables of directional albedo


def directional_albedo(alpha, cosines=COSINES, halves=(1024, 256)):
    """GGX with height-correlated Smith over `cosines` values of cos theta in (0, 1]: the parts of F0 and of F90.

    The integral over half vectors h, drawn by D(h) (n.h): the weight of each is F G2 (o.h) / ((n.o) (n.h)).
    """
    u, v = np.meshgrid(*((np.arange(n) + 0.5) / n for n in halves), indexing="ij")
    cos_h = np.sqrt((1 - u) / (1 + (alpha * alpha - 1) * u))
    sin_h = np.sqrt(1 - cos_h**2)
    h = np.stack([sin_h * np.cos(np.pi * v), sin_h * np.sin(np.pi * v), cos_h])  # half a turn is enough
    table = np.zeros((cosines, 2))
    for i, mu in enumerate(np.linspace(1 / cosines, 1, cosines)):
        o = np.array([np.sqrt(1 - mu * mu), 0.0, mu])
        oh = np.tensordot(o, h, 1)
        ni = 2 * oh * h[2] - mu
        ni_safe = np.maximum(ni, 1e-9)
        smith = lambda c: np.sqrt(1 + alpha * alpha * (1 / (c * c) - 1))  # noqa: E731
        weight = np.where((oh > 0) & (ni > 0), 2 / (smith(mu) + smith(ni_safe)) * oh / (mu * h[2]), 0)
        schlick = np.clip(1 - oh, 0, 1) ** 5
        table[i] = (weight * (1 - schlick)).mean(), (weight * schlick).mean()
    return table


class Gltf(mi.BSDF):
    """glTF 2.0 metallic-roughness without textures; a mirror where roughness is 0."""

    def __init__(self, props):
        mi.BSDF.__init__(self, props)
        base = np.array(props["base_color"])
        metallic = props["metallic"]
        self.f0 = mi.Color3f(0.04 * (1 - metallic) + base * metallic)
        self.lambert = mi.Color3f(base * (1 - metallic))
        self.compensated = props.get("compensated", True)
        self.alpha = props["roughness"] ** 2
        self.mirror = self.alpha == 0
        if self.mirror and metallic < 1:
            raise ValueError("a mirror without a lobe below it is all that is written here")
        self.lobe_share = 1.0 if metallic == 1 else 0.5
        sides = mi.BSDFFlags.FrontSide
        kind = mi.BSDFFlags.DeltaReflection if self.mirror else mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.DiffuseReflection
        self.m_components = [kind | sides]
        self.m_flags = kind | sides
        if not self.mirror:
            table = directional_albedo(self.alpha)
            self.part_f0, self.part_f90 = mi.Float(table[:, 0]), mi.Float(table[:, 1])

    def schlick(self, cosine):
        return self.f0 + (1 - self.f0) * dr.maximum(1 - cosine, 0) ** 5

    def energy(self, cosine):
        """The parts of F0 and F90 in the directional albedo, linear between the table's entries."""
        at = dr.clip(cosine * COSINES - 1, 0, COSINES - 1.001)
        low = mi.UInt32(at)
        part = lambda t: dr.lerp(dr.gather(mi.Float, t, low), dr.gather(mi.Float, t, low + 1), at - mi.Float(low))  # noqa: E731
        return part(self.part_f0), part(self.part_f90)

    def value(self, wi, wo):
        """BRDF times cosine. wi looks to the eye, as everywhere in Mitsuba."""
        nv, nl = wi.z, wo.z
        h = dr.normalize(wi + wo)
        a2 = self.alpha**2
        d = a2 / (dr.pi * ((h.z * h.z) * (a2 - 1) + 1) ** 2)
        v = 0.5 / (nl * dr.sqrt(nv * nv * (1 - a2) + a2) + nv * dr.sqrt(nl * nl * (1 - a2) + a2))
        x, y = self.energy(nv)
        scale = 1 + self.f0 * (1 / (x + y) - 1) if self.compensated else mi.Color3f(1)
        lambert = self.lambert / dr.pi * (1 - dr.minimum(dr.max((self.f0 * x + y) * scale), 1))
        return (lambert + self.schlick(dr.dot(wi, h)) * scale * d * v) * nl

    def density(self, wi, wo):
        h = dr.normalize(wi + wo)
        lobe = mi.MicrofacetDistribution(mi.MicrofacetType.GGX, self.alpha).pdf(wi, h) / (4 * dr.dot(wo, h))
        return self.lobe_share * lobe + (1 - self.lobe_share) * wo.z / dr.pi

    def sample(self, context, si, sample1, sample2, active):
        wi = si.wi
        bs = dr.zeros(mi.BSDFSample3f)
        bs.eta = 1.0
        bs.sampled_component = 0
        active &= wi.z > 0
        if self.mirror:
            bs.wo = mi.reflect(wi)
            bs.pdf = 1.0
            bs.sampled_type = mi.UInt32(mi.BSDFFlags.DeltaReflection.value)
            return bs, self.schlick(wi.z) & active
        m, _ = mi.MicrofacetDistribution(mi.MicrofacetType.GGX, self.alpha).sample(wi, sample2)
        bs.wo = dr.select(sample1 < self.lobe_share, mi.reflect(wi, m), mi.warp.square_to_cosine_hemisphere(sample2))
        active &= bs.wo.z > 0
        bs.pdf = dr.select(active, self.density(wi, bs.wo), 0)
        bs.sampled_type = mi.UInt32(self.m_flags)
        active &= bs.pdf > 0
        return bs, (self.value(wi, bs.wo) / bs.pdf) & active

    def eval(self, context, si, wo, active):
        if self.mirror:
            return mi.Color3f(0)
        return self.value(si.wi, wo) & (active & (si.wi.z > 0) & (wo.z > 0))

    def pdf(self, context, si, wo, active):
        if self.mirror:
            return mi.Float(0)
        return dr.select(active & (si.wi.z > 0) & (wo.z > 0), self.density(si.wi, wo), 0)

    def eval_pdf(self, context, si, wo, active):
        return self.eval(context, si, wo, active), self.pdf(context, si, wo, active)

    def to_string(self):
        return f"Gltf[alpha={self.alpha}]"


mi.register_bsdf("gltf", Gltf)


def rgb(values):
    return {"type": "rgb", "value": [float(v) for v in values]}


def lambert(albedo):
    return {"type": "diffuse", "reflectance": albedo}


def camera(position, look_at, fov_y, size):
    film = {"type": "hdrfilm", "width": size[0], "height": size[1], "rfilter": {"type": "box"}, "pixel_format": "rgb", "component_format": "float32"}
    place = mi.ScalarTransform4f().look_at(origin=position, target=look_at, up=[0, 1, 0])
    sensor = {"type": "perspective", "fov": fov_y, "fov_axis": "y", "near_clip": 1e-3, "to_world": place, "film": film}
    return sensor | {"sampler": {"type": "independent"}}


def box_room(file, size):
    """The boxes of balls.json, seen by the camera of a file; and its balls."""
    boxes = json.loads((HERE / "balls.json").read_text())["boxes"]
    scene = json.loads((HERE / file).read_text())
    world = {"type": "scene", "sensor": camera(**scene["camera"], size=size)}
    T = mi.ScalarTransform4f
    for i, box in enumerate(boxes):
        place = T().translate(box["at"]).scale([0.5 * s for s in box["size"]])
        shape = {"type": "cube", "to_world": place, "bsdf": lambert(rgb(box["base_color"]))}
        if "emissive" in box:
            shape["emitter"] = {"type": "area", "radiance": rgb(box["emissive"])}
        world[f"box{i}"] = shape
    return world, scene["balls"]


def balls(size):
    world, shapes = box_room("balls.json", size)
    for i, ball in enumerate(shapes):
        material = {key: ball[key] for key in ["metallic", "roughness"]}
        material = mi.load_dict({"type": "gltf", "base_color": mi.ScalarColor3f(ball["base_color"]), **material})
        world[f"ball{i}"] = {"type": "sphere", "center": ball["at"], "radius": ball["radius"], "bsdf": material}
    return world


def plugin(ball):
    """Mitsuba's material for what a ball's values mean in glTF, and the medium in it.

    It knows no compensation for multiple scattering, so roughness is small: a ball of `roughdielectric` in a white furnace shows
    0.998 in the middle at roughness 0.2, and 0.982 at 0.3. A thin sheet is that whose
    reflection at normal incidence, bounces within it included, is F0 = 0.04: 2 R / (1 + R) with R = 1/49, an index of 4/3.
    """
    alpha, clear = ball["roughness"] ** 2, {"type": ball["plugin"], "ext_ior": 1.0, "int_ior": 1.5}
    kinds = {
        "principled": lambda: {
            "type": "principled", "base_color": rgb(ball["base_color"]), "roughness": ball["roughness"],
            "metallic": ball["metallic"], "spec_trans": ball.get("transmission", 0.0), "eta": 1.5,
        },
        "roughconductor": lambda: {
            "type": "roughconductor", "material": "none", "distribution": "ggx", "alpha_v": alpha,
            "alpha_u": alpha + (1 - alpha) * ball["anisotropy"] ** 2,
        },
        "roughdielectric": lambda: clear | {"distribution": "ggx", "alpha": alpha},
        "dielectric": lambda: clear,
        "thindielectric": lambda: clear | {"int_ior": 4 / 3},
    }  # fmt: skip
    shape = {"bsdf": kinds[ball["plugin"]]()}
    if "attenuation_distance" in ball:
        sigma = [-math.log(c) / ball["attenuation_distance"] for c in ball["attenuation_color"]]
        share = rgb([s / max(sigma) for s in sigma])
        shape["interior"] = {"type": "homogeneous", "albedo": 0.0, "sigma_t": share, "scale": max(sigma)}
    return shape


def spheres(size):
    """The balls of spheres.json. Their poles are above and below, so that Mitsuba's tangent is the glTF test's."""
    world, shapes = box_room("spheres.json", size)
    T = mi.ScalarTransform4f
    for i, ball in enumerate(shapes):
        place = T().translate(ball["at"]).rotate([1, 0, 0], -90).scale(ball["radius"])
        world[f"ball{i}"] = {"type": "sphere", "to_world": place} | plugin(ball)
    return world


def write_ply(path, vertices, faces):
    """Writes positions, normals and texture coordinates, eight numbers a vertex, and triangles."""
    properties = "".join(f"property float {p}\n" for p in ["x", "y", "z", "nx", "ny", "nz", "u", "v"])
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n{properties}"
    header += f"element face {len(faces)}\nproperty list uchar uint vertex_indices\nend_header\n"
    rows = np.zeros(len(faces), [("n", "u1"), ("v", "<u4", 3)])
    rows["n"], rows["v"] = 3, faces
    path.write_bytes(header.encode() + vertices.astype("<f4").tobytes() + rows.tobytes())


class Glb:
    """As much of a .glb as the room needs: meshes at the origin, float arrays, Lambert or metal."""

    def __init__(self, path):
        data = path.read_bytes()
        length = struct.unpack("<I", data[12:16])[0]
        self.json = json.loads(data[20 : 20 + length])
        self.binary = data[28 + length :]

    def view(self, index):
        view = self.json["bufferViews"][index]
        start = view.get("byteOffset", 0)
        return self.binary[start : start + view["byteLength"]]

    def array(self, index):
        a = self.json["accessors"][index]
        kind = {5126: "<f4", 5125: "<u4", 5123: "<u2"}[a["componentType"]]
        width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}[a["type"]]
        array = np.frombuffer(self.view(a["bufferView"]), kind, a["count"] * width, a.get("byteOffset", 0))
        return array.reshape(a["count"], width)

    def shapes(self, folder, compensated):
        assert all(set(node) <= {"name", "mesh"} for node in self.json["nodes"]), "nodes without transforms"
        for node in self.json["nodes"]:
            (primitive,) = self.json["meshes"][node["mesh"]]["primitives"]
            at = primitive["attributes"]
            vertices = np.hstack([self.array(at[k]) for k in ["POSITION", "NORMAL", "TEXCOORD_0"]])
            faces = self.array(primitive["indices"]).reshape(-1, 3).astype("<u4")
            path = folder / f"{node['name']}.ply"
            write_ply(path, vertices, faces)
            material = self.json["materials"][primitive["material"]]
            shape = {"type": "ply", "filename": str(path), "bsdf": self.material(material, compensated)}
            if "emissiveFactor" in material:
                strength = material["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"]
                shape["emitter"] = {"type": "area", "radiance": rgb([strength * e for e in material["emissiveFactor"]])}
            yield node["name"], shape

    def material(self, material, compensated):
        pbr = material["pbrMetallicRoughness"]
        if pbr["metallicFactor"] == 1:
            base = mi.ScalarColor3f(pbr["baseColorFactor"][:3])
            metal = {"metallic": 1.0, "roughness": pbr["roughnessFactor"], "compensated": compensated}
            return mi.load_dict({"type": "gltf", "base_color": base, **metal})
        assert material["extensions"]["KHR_materials_specular"]["specularFactor"] == 0, "pure Lambert"
        if "baseColorTexture" not in pbr:
            return lambert(rgb(pbr["baseColorFactor"][:3]))
        image = self.json["images"][self.json["textures"][pbr["baseColorTexture"]["index"]]["source"]]
        stream = mi.MemoryStream()
        stream.write(self.view(image["bufferView"]))
        stream.seek(0)
        bitmap = mi.Bitmap(stream)
        return lambert({"type": "bitmap", "bitmap": bitmap, "filter_type": "nearest", "wrap_mode": "clamp"})


def room(size, source, compensated):
    """rooms/room of the test data: room.glb and objects.glb, seen as scene.toml says."""
    import tomllib

    view = tomllib.loads((source / "scene.toml").read_text())["camera"]
    world = {"type": "scene", "sensor": camera(view["position"], view["look_at"], view["fov_y"], size)}
    with tempfile.TemporaryDirectory() as folder:
        for file in ["room.glb", "objects.glb"]:
            world.update(Glb(source / file).shapes(Path(folder), compensated))
        return mi.load_dict(world)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", choices=list(SIZES))
    parser.add_argument("source", nargs="?", type=Path)
    parser.add_argument("--runs", type=int, default=16)
    parser.add_argument("--spp", type=int, default=16384, help="samples a pixel and run")
    parser.add_argument("--plain", action="store_true", help="metal without compensation (room)")
    parser.add_argument("--exr", type=Path, help="one run of 512 pixels width as a picture, and nothing else")
    args = parser.parse_args()
    size = SIZES[args.scene]
    if args.exr:
        size = (512, 512 * size[1] // size[0])
    if args.scene == "room":
        scene = room(size, args.source, not args.plain)
    else:
        scene = mi.load_dict({"balls": balls, "spheres": spheres}[args.scene](size))
    kind = "volpath" if args.scene == "spheres" else "path"  # which absorbs in a solid
    integrator = mi.load_dict({"type": kind, "max_depth": -1, "rr_depth": 8})
    render = lambda seed: np.array(mi.render(scene, integrator=integrator, spp=args.spp, seed=seed))  # noqa: E731
    if args.exr:
        mi.Bitmap(render(0)).write(str(args.exr))
        return
    pictures = np.stack([render(seed).astype(np.float64) for seed in range(args.runs)])
    mean, error = pictures.mean(0), pictures.std(0, ddof=1) / np.sqrt(args.runs)
    digits = lambda a: [[[float(f"{x:.6g}") for x in pixel] for pixel in row] for row in a]  # noqa: E731
    facts = {"made_by": f"Mitsuba {mi.__version__}, {mi.variant()}", "samples": args.runs * args.spp, "size": list(size)}
    lines = [f'    "{key}": {json.dumps(value)}' for key, value in facts.items()]
    for key, values in [("mean", mean), ("standard_error", error)]:
        rows = ",\n".join("        " + json.dumps(row) for row in digits(values))
        lines.append(f'    "{key}": [\n{rows}\n    ]')
    suffix = "plain_values" if args.plain else "values"
    (HERE / f"{args.scene}_{suffix}.json").write_text("{\n" + ",\n".join(lines) + "\n}\n")
    print(f"mean {mean.mean():.5f}, largest standard error {100 * (error / mean).max():.3f} %")


if __name__ == "__main__":
    main()
