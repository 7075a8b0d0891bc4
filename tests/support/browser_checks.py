"""Measurements of a page in a browser."""

# Of each text of a plot that is shown: the contrast with its ground, and the text.
CONTRAST = """() => {
  const canvas = document.createElement("canvas").getContext("2d", {willReadFrequently: true});
  const light = colour => {
    canvas.fillStyle = colour; canvas.fillRect(0, 0, 1, 1);
    const linear = [...canvas.getImageData(0, 0, 1, 1).data].slice(0, 3).map(v => v / 255)
      .map(v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2];
  };
  const texts = [...document.querySelectorAll(".plot text")].filter(e => e.getClientRects().length);
  return texts.map(e => {
    const pair = [getComputedStyle(e).fill, getComputedStyle(e.closest(".plot")).backgroundColor].map(light);
    return [(Math.max(...pair) + 0.05) / (Math.min(...pair) + 0.05), e.textContent];
  });
}"""
