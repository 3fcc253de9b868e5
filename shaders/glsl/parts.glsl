// Parts of the model that a plan leaves out (src/plan). A part that is 0 is not compiled in, and its own
// images are absent.
layout(constant_id = 16) const uint VIRTUAL_SURFACES = 1; // virtual surfaces are seen in this view
layout(constant_id = 17) const uint SPECULAR = 1;         // virtual surfaces have a GGX lobe
layout(constant_id = 18) const uint EMISSION = 1;         // virtual surfaces shine
layout(constant_id = 19) const uint TEXTURES = 1;         // materials have textures
layout(constant_id = 20) const uint LIT = 1;              // objects light surfaces; without any, L_cam is all
layout(constant_id = 21) const uint OBJECT_MOTION = 1;    // objects move
layout(constant_id = 22) const uint INTERREFLECTION = 1;  // a path that leaves an object may meet another
layout(constant_id = 23) const uint SHOWN = 1;            // the view is the picture, not a map of irradiance

// Says whether b holds anything for a layer: ΔE of real surfaces, the GGX lobe of virtual ones.
bool has_b(int layer) { return SPECULAR != 0u || layer == REAL; }
