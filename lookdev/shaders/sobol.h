// Owen-scrambled Sobol points, computed: on 4.5 a table look-up costs ten times as much.
//
// Sobol's first dimension is the bit reversal of the index; the second is Pascal's matrix modulo 2 applied to it,
// the polynomial i(x + 1) over GF(2), which halves solve recursively. Scrambling follows Laine and Karras 2011 with
// the constants of Vegdahl 2021, index shuffling Burley 2020 ("Practical Hash-based Owen Scrambling").
// Integers are 32 bits and signed: every right shift is masked. The text is OSL, and GLSL but for the word `output`.

int sobol_reverse(int value)
{
    int x = value;
    x = ((x >> 1) & 0x55555555) | ((x & 0x55555555) << 1);
    x = ((x >> 2) & 0x33333333) | ((x & 0x33333333) << 2);
    x = ((x >> 4) & 0x0f0f0f0f) | ((x & 0x0f0f0f0f) << 4);
    x = ((x >> 8) & 0x00ff00ff) | ((x & 0x00ff00ff) << 8);
    return ((x >> 16) & 0x0000ffff) | (x << 16);
}

// A random permutation in which a bit is flipped depending on the bits below it only.
int sobol_laine_karras(int value, int seed)
{
    int x = value;
    x ^= x * 0x3d20adea;
    x += seed;
    x *= ((seed >> 16) & 0xffff) | 1;
    x ^= x * 0x05526c56;
    x ^= x * 0x53a22864;
    return x;
}

// Wellons' "lowbias32".
int sobol_hash(int value)
{
    int x = value;
    x ^= (x >> 16) & 0xffff;
    x *= 0x7feb352d;
    x ^= (x >> 15) & 0x1ffff;
    x *= -2073254261;  // 0x846ca68b
    x ^= (x >> 16) & 0xffff;
    return x;
}

// 24 bits of an integer as a number in [0, 1).
float sobol_unit(int x)
{
    return float((x >> 8) & 0xffffff) * (1.0 / 16777216.0);
}

// Point `index` of the sequence that `seed` scrambles.
void sobol_2d(int index, int seed, output float u1, output float u2)
{
    int i = sobol_reverse(sobol_laine_karras(sobol_reverse(index), seed));
    int p = i;
    p ^= (p >> 16) & 0x0000ffff;
    p ^= (p >> 8) & 0x00ff00ff;
    p ^= (p >> 4) & 0x0f0f0f0f;
    p ^= (p >> 2) & 0x33333333;
    p ^= (p >> 1) & 0x55555555;
    u1 = sobol_unit(sobol_reverse(sobol_laine_karras(i, sobol_hash(seed + 1))));
    u2 = sobol_unit(sobol_reverse(sobol_laine_karras(p, sobol_hash(seed + 2))));
}
