/** The picture as a PNG file: the canvas, with what it shows written below. */

const STRIP_PX = 46;

export async function savePicture(canvas, lines, colours) {
  const blob = await pictureOf(canvas, lines, colours);
  const link = document.createElement("a"),
    url = URL.createObjectURL(blob);
  link.href = url;
  link.download = `mapod-${new Date().toISOString().slice(0, 19).replace(/[-:]/g, "").replace("T", "-")}.png`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(url), 10_000);
  return link.download;
}

export function pictureOf(canvas, lines, colours) {
  const sheet = document.createElement("canvas"),
    ratio = canvas.width / Math.max(1, canvas.clientWidth);
  sheet.width = canvas.width;
  sheet.height = canvas.height + STRIP_PX * ratio;
  const context = sheet.getContext("2d");
  context.fillStyle = colours.panel;
  context.fillRect(0, 0, sheet.width, sheet.height);
  context.drawImage(canvas, 0, 0);
  context.scale(ratio, ratio);
  context.fillStyle = colours.ink;
  lines.forEach((line, k) => {
    context.font = `${k === 0 ? 600 : 400} 13px system-ui, sans-serif`;
    context.fillText(line, 12, canvas.clientHeight + 18 + 18 * k);
  });
  return new Promise((resolve) => sheet.toBlob(resolve, "image/png"));
}
