// Which of a pixel's samples this is, 0 to samples - 1, each once where `samples` is a power of two.
//
// With motion blur on and nothing moving, `time` is Cycles' own stratified number u after it went through the table
// of the shutter: 256 entries that hold (i + 1/2) / 256, read so that time = (1/2 + 254 u) / 256 (measured on 4.5 and
// 5.2). Without the inverse, a quarter of 64 samples would be off by one. The table's rounding leaves 2e-6 of doubt
// about u.
int stratum(float when, int samples)
{
    return clamp(int((256 * when - 0.5) / 254 * samples), 0, samples - 1);
}
