// The movie of a page: picture by picture, and enlarged. Safari plays no movie from a data URL, so it becomes a file here.
function showMovie(root) {
  const video = root.querySelector("video");
  const bytes = Uint8Array.from(atob(video.getAttribute("src").split(",")[1]), letter => letter.charCodeAt(0));
  video.poster = root.querySelector("img").src;  // which is printed in its place
  video.src = URL.createObjectURL(new Blob([bytes], {type: "video/mp4"}));
  root.querySelectorAll("[data-step]").forEach(button => button.addEventListener("click", () => {
    const step = Number(button.dataset.step), length = Math.abs(step);
    video.pause();
    // The middle of a picture: at its edge a browser may show the one before.
    const at = (Math.floor(video.currentTime / length + 1e-3) + Math.sign(step) + 0.5) * length;
    video.currentTime = Math.max(0.5 * length, Math.min(at, video.duration - 0.01));
  }));
  root.querySelector("[data-enlarge]").addEventListener("click", () => {
    if (document.fullscreenElement) document.exitFullscreen();
    else if (video.requestFullscreen) video.requestFullscreen();
    else video.webkitEnterFullscreen();  // on an iPhone
  });
}
