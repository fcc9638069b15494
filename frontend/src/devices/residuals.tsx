/** What is left of each measured point after the correction, between the limits asked for. */

import { amountText, residualPlot, signedText } from "@/model/calibration";
import { formatNumber, THIN } from "@/model/format";
import type { CalibratedQuantity, Calibration } from "@/model/wirecalibration";
import { words } from "./words";

const percent = (share: number): string => `${share * 100}%`;

export function Residuals({ row, kind }: { row: Calibration; kind: CalibratedQuantity }) {
  const plot = residualPlot(row, kind);
  if (!plot) return null;
  const [upper, lower] = plot.limits;
  return (
    <figure className="residuals" data-testid="residuals">
      <figcaption className="t12 m">{words.calibration.residuals}</figcaption>
      <div
        className="field2d"
        role="img"
        aria-label={`${words.calibration.residuals}: ${plot.dots.length} points, limits ± ${amountText(row.tolerance, kind)}`}
      >
        <i className="rule zero" style={{ top: "50%" }} />
        <i className="rule limit" style={{ top: percent(upper) }} />
        <i className="rule limit" style={{ top: percent(lower) }} />
        {plot.dots.map((dot, at) => (
          <i
            key={at}
            className="dot"
            style={{ left: percent(dot.x), top: percent(dot.y) }}
            title={`${formatNumber(dot.value, 1)}${THIN}${kind.unit}: ${signedText(dot.residual, kind)}`}
          />
        ))}
        <span className="tick num" style={{ top: percent(upper) }}>
          +{amountText(row.tolerance, kind)}
        </span>
        <span className="tick num" style={{ top: "50%" }}>
          0
        </span>
        <span className="tick num" style={{ top: percent(lower) }}>
          −{amountText(row.tolerance, kind)}
        </span>
      </div>
      <div className="xaxis t12 m num">
        <span>{formatNumber(plot.start, 0)}</span>
        <span>
          {formatNumber(plot.end, kind.is_relative ? 0 : 2)}
          {THIN}
          {kind.unit}
        </span>
      </div>
    </figure>
  );
}
