// A deliberate fault, by which tests prove that the stability suite notices faults (`Fault` in
// src/passes/fault.rs). Only the cargo feature `faults` builds shaders with it. In all others FAULT is 0, and
// the compiler drops what depends on it.
#ifdef FAULTS
layout(constant_id = 8) const uint FAULT = 0u;
#else
const uint FAULT = 0u;
#endif
const uint FAULT_NO_WRAP = 1u;
const uint FAULT_NO_POLES = 2u;
const uint FAULT_YAW_FORGOTTEN = 3u;
const uint FAULT_ENERGY_CLAMP = 5u;
const uint FAULT_MOTION_OFF = 6u;
const uint FAULT_RAYS_FROM_BELOW = 7u;
const uint FAULT_HOLES_NEAR = 8u;
const uint FAULT_REAL_IGNORED = 9u;
const uint FAULT_CAMERA_CENTRED = 10u;
const uint FAULT_NORMALS_UNTURNED = 11u;
const uint FAULT_FILTER_BLIND = 12u;
const uint FAULT_LAST_TILE_LOST = 13u;
const uint FAULT_NARROW_COLUMNS = 14u;
const uint FAULT_DRIFT = 15u;
const uint FAULT_HISTORY_OF_OTHERS = 16u;
const uint FAULT_TEXTURES_FINEST = 17u;
const uint FAULT_ONE_JOINT = 18u;
