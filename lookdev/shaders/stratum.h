// The number of a pixel's sample, 0 to samples - 1; each occurs once where `samples` is a power of two.
//
// With motion blur on and nothing moving, `time` is Cycles' stratified number u mapped by the table of the shutter:
// 256 entries (i + 1/2) / 256, interpolated such that time = (1/2 + 254 u) / 256 (measured on 4.5 and 5.2). Without
// the inverse, a quarter of 64 samples would be off by one. The rounding of the table changes u by up to 2e-6.
int stratum(float when, int samples)
{
    return clamp(int((256 * when - 0.5) / 254 * samples), 0, samples - 1);
}
