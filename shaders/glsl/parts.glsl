// Parts of the model that a plan leaves out (src/plan). A part that is 0 is not compiled in, and its own
// images are absent.
layout(constant_id = 16) const uint VIRTUAL_SURFACES = 1; // virtual surfaces are seen in this view
layout(constant_id = 17) const uint SPECULAR = 1;         // virtual surfaces have a GGX lobe
layout(constant_id = 18) const uint EMISSION = 1;         // virtual surfaces shine
// A bit for each slot that any material has a texture in; the highest bit: some lie on other coordinates than the
// vertices' first as they are.
layout(constant_id = 19) const uint TEXTURES = 0xffffffffu;
layout(constant_id = 40) const uint ALPHA = 1;            // of virtual surfaces not all is there
layout(constant_id = 41) const uint TRANSMISSION = 1;     // virtual surfaces let light through
layout(constant_id = 42) const uint CLEARCOAT = 1;        // virtual surfaces have clear coats
layout(constant_id = 43) const uint SHEEN = 1;            // virtual surfaces have sheen
layout(constant_id = 44) const uint ANISOTROPY = 1;       // virtual surfaces are rougher along one direction
layout(constant_id = 45) const uint IRIDESCENCE = 1;      // virtual surfaces have thin films
layout(constant_id = 20) const uint LIT = 1;              // objects light surfaces; without any, L_cam is all
layout(constant_id = 21) const uint OBJECT_MOTION = 1;    // objects move
layout(constant_id = 22) const uint INTERREFLECTION = 1;  // a path that leaves an object may meet another
layout(constant_id = 23) const uint SHOWN = 1;            // the view is the picture, not a map of irradiance

layout(constant_id = 48) const uint REFLECTIONS = 1;       // reflections move over what shows them
layout(constant_id = 47) const uint EMITTERS = 1;         // rays aim at virtual surfaces that shine
layout(constant_id = 49) const uint PUNCTUAL = 1;         // objects bring lights without a surface
layout(constant_id = 46) const uint DEFORMATION = 1;      // objects change their shape

// Says whether b holds anything for a layer: ΔE of real surfaces, all lobes but Lambert's of virtual ones.
bool has_b(int layer) { return SPECULAR != 0u || layer == REAL; }
