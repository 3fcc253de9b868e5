// How many paths a surface gets in this frame: 0 if there is nothing to light, below 0 if it is not traced.
const float MOST_PATHS = 127.0;

float mask_at(ivec3 at) { return round(imageLoad(in_mask, at).x * MOST_PATHS); }
